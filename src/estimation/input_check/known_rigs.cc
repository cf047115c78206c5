// SPDX-License-Identifier: BSD-3-Clause
#include "input_check/known_rigs.h"

#include <algorithm>
#include <optional>
#include <string>
#include <vector>

#include "base/format.h"
#include "geometry/rigid_matrix.h"
#include "geometry/so3.h"
#include "input_check/camera_motions.h"
#include "input_check/rig_samples.h"
#include "math/statistics.h"
#include "mgsfm/base/error.h"

namespace mgsfm {
namespace {

// Other conventions for the poses in a file under which they agree with the
// matches.
struct RigConvention {
  bool is_xyzw;
  bool is_rig_from_cam;
  const char* remedy;
};

constexpr RigConvention kRigConventions[] = {
    {true, false,
     "; the order x y z w of its quaternions agrees; write w x y z"},
    {false, true,
     "; the inverse poses agree; write cam_from_rig, not rig_from_cam"},
    {true, true,
     "; the inverse poses with quaternions x y z w agree; write cam_from_rig, "
     "not rig_from_cam, with w x y z"}};

// Small for a correct rig even if half of the samples are wrong.
double LowerQuartile(const std::vector<double>& values) {
  return Quantile(values, 0.25);
}

std::string Contradiction(const Sensor& a, const Sensor& b,
                          const char* quantity, double error_rad,
                          const std::string& evidence) {
  return "the known " + std::string(quantity) + " between the cameras '" +
         a.name + "' and '" + b.name +
         "' of a rig contradicts the matches of " + evidence + " by " +
         Formatted("%.1f deg", RadToDeg(error_rad));
}

// Whether three quarters of the angles to the known value exceed
// `max_angle_rad`, and most angles to the typical value do not.
bool Contradicts(const std::vector<double>& to_known,
                 const std::vector<double>& to_typical, double max_angle_rad) {
  return to_known.size() >= kMinNumRigFrames &&
         LowerQuartile(to_known) > max_angle_rad &&
         Median(to_typical) < max_angle_rad;
}

std::optional<std::string> CheckKnownPose(const Scene& scene,
                                          const SensorPairSamples& pair) {
  const Sensor& a = scene.sensors[pair.sensor_a];
  const Sensor& b = scene.sensors[pair.sensor_b];
  const auto typical = FindTypicalPose(pair.samples);
  if (!a.sensor_from_rig || !b.sensor_from_rig || !typical) return {};
  const Rigid3 known = *b.sensor_from_rig * a.sensor_from_rig->Inverse();
  std::vector<double> to_known, to_typical;
  std::vector<double> direction_to_known, direction_to_typical;
  for (const RigSample& sample : pair.samples) {
    to_known.push_back(AngleBetween(sample.b_from_a, known.rotation));
    to_typical.push_back(AngleBetween(sample.b_from_a, typical->b_from_a));
    if (!sample.direction || !typical->direction) continue;
    direction_to_known.push_back(
        AngleBetween(*sample.direction, known.translation));
    direction_to_typical.push_back(
        AngleBetween(*sample.direction, *typical->direction));
  }
  const std::string frames = std::to_string(to_known.size()) + " frames";
  if (Contradicts(to_known, to_typical, kSameRotationRad)) {
    return Contradiction(a, b, "rotation", LowerQuartile(to_known), frames);
  }
  if (!known.translation.isZero(0.0) &&
      Contradicts(direction_to_known, direction_to_typical,
                  kSameDirectionRad)) {
    return Contradiction(a, b, "direction of the translation",
                         LowerQuartile(direction_to_known), frames);
  }
  return {};
}

std::optional<std::string> CheckKnownMotions(const Scene& scene,
                                             const MotionAgreement& motions) {
  if (motions.axis_to_known_rad.empty() ||
      !Contradicts(motions.axis_to_known_rad, motions.axis_to_fitted_rad,
                   kSameRotationRad)) {
    return {};
  }
  return Contradiction(scene.sensors[motions.sensor_a],
                       scene.sensors[motions.sensor_b], "rotation",
                       LowerQuartile(motions.axis_to_known_rad),
                       std::to_string(motions.num_motions) + " motions");
}

std::optional<std::string> FindContradiction(const Scene& scene,
                                             const ViewGraph& view_graph) {
  for (const SensorPairSamples& pair : CollectRigSamples(scene, view_graph)) {
    if (auto problem = CheckKnownPose(scene, pair)) return problem;
  }
  for (const MotionAgreement& motions : CompareMotions(scene, view_graph)) {
    if (auto problem = CheckKnownMotions(scene, motions)) return problem;
  }
  return {};
}

void Reinterpret(const RigConvention& convention, Rigid3* pose) {
  // The identity, as for the reference sensor, is the same in both orders.
  if (convention.is_xyzw && !pose->rotation.vec().isZero()) {
    pose->rotation = FromOrderXyzw(pose->rotation);
  }
  if (convention.is_rig_from_cam) *pose = pose->Inverse();
}

}  // namespace

void CheckKnownRigs(const Scene& scene, const ViewGraph& view_graph) {
  const auto num_known = std::count_if(
      scene.sensors.begin(), scene.sensors.end(), [&](const Sensor& sensor) {
        return sensor.sensor_from_rig &&
               scene.rigs[sensor.rig_idx].sensor_idxs.size() > 1;
      });
  if (num_known < 2) return;
  const auto problem = FindContradiction(scene, view_graph);
  if (!problem) return;
  for (const RigConvention& convention : kRigConventions) {
    Scene other = scene;
    for (Sensor& sensor : other.sensors) {
      if (sensor.sensor_from_rig) {
        Reinterpret(convention, &*sensor.sensor_from_rig);
      }
    }
    if (!FindContradiction(other, view_graph)) {
      throw Error(*problem + convention.remedy);
    }
  }
  throw Error(*problem +
              "; correct it, or remove the pose of one camera to estimate it");
}

}  // namespace mgsfm

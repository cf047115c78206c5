// SPDX-License-Identifier: BSD-3-Clause
#include "input_check/known_rigs.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "base/format.h"
#include "geometry/epipolar.h"
#include "geometry/rigid_matrix.h"
#include "geometry/so3.h"
#include "input_check/camera_motions.h"
#include "input_check/rig_samples.h"
#include "math/robust_scale.h"
#include "math/statistics.h"
#include "mgsfm/base/error.h"
#include "scene/observations.h"

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

// Whether three quarters of the angles to the known rotation are large, and
// most angles to the typical one are not.
bool Contradicts(const std::vector<double>& to_known,
                 const std::vector<double>& to_typical) {
  return to_known.size() >= kMinNumRigFrames &&
         LowerQuartile(to_known) > kSameRotationRad &&
         Median(to_typical) < kSameRotationRad;
}

double NoiseRad(const RayMatches& rays, const Rigid3& b_from_a) {
  return std::max(RobustSigma<1>(SampsonAngles(rays, b_from_a)),
                  std::numeric_limits<double>::epsilon());
}

// The noise of the matches about the pose that they suggest.
double NoiseRad(const RayMatches& rays, const RigSample& sample) {
  Rigid3 pose{sample.b_from_a, *sample.direction};
  PoseRefinementOptions options;
  options.loss_scale_rad = NoiseRad(rays, pose);
  RefineRelativePose(rays, options, &pose);
  return NoiseRad(rays, pose);
}

// Whether a pose explains most matches of the pair of a sample, up to a small
// rotation. In a narrow overlap, matches tell the direction and the rotation
// only together, and a calibration has errors of its rotation. A rotation along
// the epipolar lines, which moves points behind the cameras, is uncertain
// there.
bool Explains(const Scene& scene, const MatchedPairs& pairs,
              const RigSample& sample, int sensor_a, const Rigid3& b_from_a) {
  RayMatches rays = RaysOf(pairs.bearings, *sample.pair);
  if (scene.images[sample.pair->image_idx1].sensor_idx != sensor_a) {
    std::swap(rays.rays1, rays.rays2);
  }
  PoseRefinementOptions options;
  options.loss_scale_rad = NoiseRad(rays, sample);
  options.is_direction_fixed = true;
  Rigid3 pose{sample.b_from_a, b_from_a.translation};
  RefineRelativePose(rays, options, &pose);
  if (AngleBetween(pose.rotation, b_from_a.rotation) > kSameRotationRad) {
    return false;
  }
  const Eigen::Matrix3d covariance =
      RelativePoseCovariance(rays, options, pose).topLeftCorner<3, 3>();
  size_t num_explained = 0;
  for (size_t i = 0; i < rays.size(); ++i) {
    const Eigen::Vector3d axis =
        pose.translation.cross(rays.rays2[i]).normalized();
    const double sigma_rad =
        std::sqrt(options.loss_scale_rad * options.loss_scale_rad +
                  axis.dot(covariance * axis));
    num_explained +=
        std::abs(SampsonAngle(pose, rays.rays1[i], rays.rays2[i])) <=
            kRareErrorInSigmas * options.loss_scale_rad &&
        IsInFront(pose, rays.rays1[i], rays.rays2[i],
                  kRareErrorInSigmas * sigma_rad);
  }
  return 2 * num_explained > rays.size();
}

std::optional<std::string> CheckKnownRotation(const Scene& scene,
                                              const SensorPairSamples& pair,
                                              const Rigid3& known,
                                              const TypicalRigPose& typical) {
  std::vector<double> to_known, to_typical;
  for (const RigSample& sample : pair.samples) {
    to_known.push_back(AngleBetween(sample.b_from_a, known.rotation));
    to_typical.push_back(AngleBetween(sample.b_from_a, typical.b_from_a));
  }
  if (!Contradicts(to_known, to_typical)) return {};
  return Contradiction(
      scene.sensors[pair.sensor_a], scene.sensors[pair.sensor_b], "rotation",
      LowerQuartile(to_known), std::to_string(to_known.size()) + " frames");
}

std::optional<std::string> CheckKnownDirection(const Scene& scene,
                                               const MatchedPairs& pairs,
                                               const SensorPairSamples& pair,
                                               const Rigid3& known,
                                               const TypicalRigPose& typical) {
  if (known.translation.isZero(0.0) || !typical.direction) return {};
  const Rigid3 typical_pose{typical.b_from_a, *typical.direction};
  std::vector<double> to_known;
  size_t num_refuted = 0, num_typical = 0;
  for (const RigSample& sample : pair.samples) {
    if (!sample.direction) continue;
    to_known.push_back(AngleBetween(*sample.direction, known.translation));
    num_refuted += !Explains(scene, pairs, sample, pair.sensor_a, known);
    num_typical += Explains(scene, pairs, sample, pair.sensor_a, typical_pose);
  }
  if (to_known.size() < kMinNumRigFrames ||
      4 * num_refuted < 3 * to_known.size() ||
      2 * num_typical < to_known.size()) {
    return {};
  }
  return Contradiction(scene.sensors[pair.sensor_a],
                       scene.sensors[pair.sensor_b],
                       "direction of the translation", Median(to_known),
                       std::to_string(to_known.size()) + " frames");
}

std::optional<std::string> CheckKnownPose(const Scene& scene,
                                          const MatchedPairs& pairs,
                                          const SensorPairSamples& pair) {
  const Sensor& a = scene.sensors[pair.sensor_a];
  const Sensor& b = scene.sensors[pair.sensor_b];
  const auto typical = FindTypicalPose(pair.samples);
  if (!a.sensor_from_rig || !b.sensor_from_rig || !typical) return {};
  const Rigid3 known = *b.sensor_from_rig * a.sensor_from_rig->Inverse();
  if (auto problem = CheckKnownRotation(scene, pair, known, *typical)) {
    return problem;
  }
  return CheckKnownDirection(scene, pairs, pair, known, *typical);
}

std::optional<std::string> CheckKnownMotions(const Scene& scene,
                                             const MotionAgreement& motions) {
  if (motions.axis_to_known_rad.empty() ||
      !Contradicts(motions.axis_to_known_rad, motions.axis_to_fitted_rad)) {
    return {};
  }
  return Contradiction(scene.sensors[motions.sensor_a],
                       scene.sensors[motions.sensor_b], "rotation",
                       LowerQuartile(motions.axis_to_known_rad),
                       std::to_string(motions.num_motions) + " motions");
}

std::optional<std::string> FindContradiction(const Scene& scene,
                                             const MatchedPairs& pairs) {
  for (const SensorPairSamples& pair :
       CollectRigSamples(scene, pairs.view_graph)) {
    if (auto problem = CheckKnownPose(scene, pairs, pair)) return problem;
  }
  for (const MotionAgreement& motions :
       CompareMotions(scene, pairs.view_graph)) {
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

void CheckKnownRigs(const Scene& scene, const MatchedPairs& pairs) {
  const auto num_known = std::count_if(
      scene.sensors.begin(), scene.sensors.end(), [&](const Sensor& sensor) {
        return sensor.sensor_from_rig &&
               scene.rigs[sensor.rig_idx].sensor_idxs.size() > 1;
      });
  if (num_known < 2) return;
  const auto problem = FindContradiction(scene, pairs);
  if (!problem) return;
  for (const RigConvention& convention : kRigConventions) {
    Scene other = scene;
    for (Sensor& sensor : other.sensors) {
      if (sensor.sensor_from_rig) {
        Reinterpret(convention, &*sensor.sensor_from_rig);
      }
    }
    if (!FindContradiction(other, pairs)) {
      throw Error(*problem + convention.remedy);
    }
  }
  throw Error(*problem +
              "; correct it, or remove the pose of one camera to estimate it");
}

}  // namespace mgsfm

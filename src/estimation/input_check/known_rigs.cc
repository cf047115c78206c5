// SPDX-License-Identifier: BSD-3-Clause
#include "input_check/known_rigs.h"

#include <algorithm>
#include <cmath>
#include <map>
#include <optional>
#include <string>
#include <tuple>
#include <utility>
#include <vector>

#include "base/format.h"
#include "geometry/rigid_matrix.h"
#include "geometry/so3.h"
#include "mgsfm/base/error.h"

namespace mgsfm {
namespace {

using Eigen::Quaterniond;
using Eigen::Vector3d;

// The thresholds separate gross mistakes, such as an inverted pose, from an
// inaccurate calibration, which the mapper accepts.
// The lower quartile of five samples is the second smallest, so that four of
// them must contradict the rig.
constexpr size_t kMinNumFrames = 5;
// Far above the errors of a calibration and of single pairs. With twice the
// value, an error of 15 degrees is accepted (docs/results/constants.md).
constexpr double kMaxRotationDeg = 10.0;
// Unit vectors that scatter by 26 degrees have a mean of length cos(26 deg).
constexpr double kMinMeanDirection = 0.9;
// An inverted translation is wrong by 180 degrees, exchanged axes by 90: half
// of the smaller.
constexpr double kMaxDirectionDeg = 45.0;
// Twice as many as frames, because each frame is in several motions.
constexpr size_t kMinNumMotions = 10;
// An error of one degree turns the axis of such a rotation by 0.2 rad, less
// than half of what kMaxAxisError allows.
constexpr double kMinRotationDeg = 5.0;
// The sine of half of the angle: axes differ by 29 degrees.
constexpr double kMaxAxisError = 0.25;
// Two cameras of a rig rotate by equal angles, whatever their poses in it.
// Wrong pairs do not, and on a straight drive all large rotations are those of
// wrong pairs.
// The error of a pair, which is larger for large rotations. Half or twice the
// values change no verdict (docs/results/constants.md).
constexpr double kMaxAngleDifference = 0.1;  // relative, and
constexpr double kMaxAngleDifferenceDeg = 1.0;
// A majority.
constexpr double kMinEqualShare = 0.5;

// Other meanings of the poses in a file, by which they agree with the matches.
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

// Indices of two sensors of one rig.
using SensorIdxs = std::pair<int, int>;

struct FrameSamples {
  std::vector<double> rotation_errors_deg;
  std::vector<Vector3d> directions;  // of cam2_from_cam1
};

// Rotations of two sensors between the same frames.
struct MotionSamples {
  size_t num_compared = 0;
  std::vector<double> axis_errors;  // of those with equal angles
};

// The rotation of one sensor from one frame to another.
struct SensorMotion {
  int frame1 = 0;  // < frame2
  int frame2 = 0;
  int sensor = 0;
  Quaterniond rotation;

  std::pair<int, int> Frames() const { return {frame1, frame2}; }
};

// Small for a correct rig, even if half of the pairs are wrong.
double LowerQuartile(std::vector<double> values) {
  const auto nth = values.begin() + values.size() / 4;
  std::nth_element(values.begin(), nth, values.end());
  return *nth;
}

// Deviations of the measurements from the known poses, per pair of sensors.
struct RigDeviations {
  std::map<SensorIdxs, FrameSamples> frame_samples;    // within frames
  std::map<SensorIdxs, MotionSamples> motion_samples;  // between frames
};

// Whether two different sensors of one rig both have known poses.
bool AreKnown(const Scene& scene, int sensor1, int sensor2) {
  const Sensor& a = scene.sensors[sensor1];
  const Sensor& b = scene.sensors[sensor2];
  return sensor1 != sensor2 && a.rig_idx == b.rig_idx && a.sensor_from_rig &&
         b.sensor_from_rig;
}

Rigid3 KnownRelativePose(const Scene& scene, const SensorIdxs& sensors) {
  return *scene.sensors[sensors.second].sensor_from_rig *
         scene.sensors[sensors.first].sensor_from_rig->Inverse();
}

void AddSampleWithinFrame(const Scene& scene, const SensorIdxs& sensors,
                          const RelativePose& pose, RigDeviations* deviations) {
  FrameSamples& samples = deviations->frame_samples[sensors];
  samples.rotation_errors_deg.push_back(RadToDeg(AngleBetween(
      KnownRelativePose(scene, sensors).rotation, pose.cam2_from_cam1)));
  if (pose.translation_direction) {
    samples.directions.push_back(*pose.translation_direction);
  }
}

SensorMotion MotionOf(const Image& image1, const Image& image2,
                      const RelativePose& pose) {
  const bool is_forward = image1.frame_idx < image2.frame_idx;
  return {std::min(image1.frame_idx, image2.frame_idx),
          std::max(image1.frame_idx, image2.frame_idx), image1.sensor_idx,
          is_forward ? pose.cam2_from_cam1 : pose.cam2_from_cam1.conjugate()};
}

bool AreEqualAngles(double a, double b) {
  return std::abs(a - b) <= kMaxAngleDifference * std::max(a, b) +
                                DegToRad(kMaxAngleDifferenceDeg);
}

// Compares the motions of every two known sensors between the same frames. The
// angle between two rotations, relative to twice their angle, is the sine of
// half of the angle between their axes.
void CompareMotions(const Scene& scene, std::vector<SensorMotion> motions,
                    RigDeviations* deviations) {
  std::sort(motions.begin(), motions.end(),
            [](const SensorMotion& a, const SensorMotion& b) {
              return std::tie(a.frame1, a.frame2, a.sensor) <
                     std::tie(b.frame1, b.frame2, b.sensor);
            });
  for (auto a = motions.begin(); a != motions.end(); ++a) {
    const double angle = AngleBetween(a->rotation, Quaterniond::Identity());
    for (auto b = a + 1; b != motions.end() && b->Frames() == a->Frames();
         ++b) {
      const double other_angle =
          AngleBetween(b->rotation, Quaterniond::Identity());
      if (!AreKnown(scene, a->sensor, b->sensor) ||
          std::max(angle, other_angle) < DegToRad(kMinRotationDeg)) {
        continue;
      }
      const SensorIdxs sensors(a->sensor, b->sensor);
      MotionSamples& samples = deviations->motion_samples[sensors];
      ++samples.num_compared;
      if (!AreEqualAngles(angle, other_angle)) continue;
      const Quaterniond b_from_a = KnownRelativePose(scene, sensors).rotation;
      samples.axis_errors.push_back(
          AngleBetween(b_from_a * a->rotation * b_from_a.conjugate(),
                       b->rotation) /
          (2.0 * angle));
    }
  }
}

RigDeviations MeasureDeviations(const Scene& scene,
                                const ViewGraph& view_graph) {
  RigDeviations deviations;
  std::vector<SensorMotion> motions;
  for (const ImagePair& pair : view_graph.pairs) {
    if (!pair.relative_pose) continue;
    const Image& image1 = scene.images[pair.image_idx1];
    const Image& image2 = scene.images[pair.image_idx2];
    if (image1.frame_idx != image2.frame_idx) {
      if (image1.sensor_idx != image2.sensor_idx) continue;
      motions.push_back(MotionOf(image1, image2, *pair.relative_pose));
    } else if (AreKnown(scene, image1.sensor_idx, image2.sensor_idx)) {
      AddSampleWithinFrame(scene, {image1.sensor_idx, image2.sensor_idx},
                           *pair.relative_pose, &deviations);
    }
  }
  CompareMotions(scene, std::move(motions), &deviations);
  return deviations;
}

std::string Contradiction(const Scene& scene, const SensorIdxs& sensors,
                          const char* quantity, double error_deg,
                          size_t num_samples) {
  const std::string number = Formatted("%.1f", error_deg);
  return "the known " + std::string(quantity) + " between the cameras '" +
         scene.sensors[sensors.first].name + "' and '" +
         scene.sensors[sensors.second].name +
         "' of a rig contradicts the matches of " +
         std::to_string(num_samples) + " frames by " + number + " deg";
}

std::optional<std::string> CheckDirections(
    const Scene& scene, const SensorIdxs& sensors,
    const std::vector<Vector3d>& directions) {
  const Vector3d known = KnownRelativePose(scene, sensors).translation;
  if (directions.size() < kMinNumFrames || known.isZero(0.0)) return {};
  Vector3d mean = Vector3d::Zero();
  for (const Vector3d& direction : directions) mean += direction;
  mean /= static_cast<double>(directions.size());
  if (mean.norm() < kMinMeanDirection) return {};
  const double error_deg = RadToDeg(AngleBetween(known, mean));
  if (error_deg <= kMaxDirectionDeg) return {};
  return Contradiction(scene, sensors, "direction of the translation",
                       error_deg, directions.size());
}

std::optional<std::string> FindContradiction(const Scene& scene,
                                             const ViewGraph& view_graph) {
  const RigDeviations deviations = MeasureDeviations(scene, view_graph);
  for (const auto& [sensors, samples] : deviations.frame_samples) {
    const size_t num_frames = samples.rotation_errors_deg.size();
    if (num_frames < kMinNumFrames) continue;
    const double error_deg = LowerQuartile(samples.rotation_errors_deg);
    if (error_deg > kMaxRotationDeg) {
      return Contradiction(scene, sensors, "rotation", error_deg, num_frames);
    }
    auto problem = CheckDirections(scene, sensors, samples.directions);
    if (problem) return problem;
  }
  for (const auto& [sensors, samples] : deviations.motion_samples) {
    const std::vector<double>& errors = samples.axis_errors;
    if (errors.size() < kMinNumMotions ||
        static_cast<double>(errors.size()) <
            kMinEqualShare * static_cast<double>(samples.num_compared)) {
      continue;
    }
    const double error = LowerQuartile(errors);
    if (error > kMaxAxisError) {
      return Contradiction(scene, sensors, "rotation",
                           RadToDeg(2.0 * std::asin(std::min(1.0, error))),
                           errors.size());
    }
  }
  return std::nullopt;
}

void Reinterpret(const RigConvention& convention, Rigid3* pose) {
  // A pose without rotation, as that of the reference, has no order.
  if (convention.is_xyzw && !pose->rotation.vec().isZero()) {
    pose->rotation = FromOrderXyzw(pose->rotation);
  }
  if (convention.is_rig_from_cam) *pose = pose->Inverse();
}

}  // namespace

void CheckKnownRigs(const Scene& scene, const ViewGraph& view_graph) {
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

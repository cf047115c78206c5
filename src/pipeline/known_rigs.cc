// SPDX-License-Identifier: BSD-3-Clause
#include "pipeline/known_rigs.h"

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <map>
#include <string>
#include <tuple>
#include <utility>
#include <vector>

#include "geometry/so3.h"
#include "mgsfm/base/error.h"

namespace mgsfm {
namespace {

using Eigen::Quaterniond;
using Eigen::Vector3d;

constexpr size_t kMinNumFrames = 5;
constexpr double kMaxRotationDeg = 10.0;
constexpr double kMinMeanDirection = 0.9;
constexpr double kMaxDirectionDeg = 45.0;
constexpr size_t kMinNumTurns = 10;
constexpr double kMinTurnDeg = 5.0;
// The sine of half of the angle between the axes.
constexpr double kMaxAxisError = 0.25;

constexpr const char* kRemedy =
    "; correct it (poses are cam_from_rig, not rig_from_cam), or leave out the "
    "pose of one to have it estimated";

// Two sensors of one rig, by position.
using SensorPair = std::pair<int, int>;

struct FrameSamples {
  std::vector<double> rotation_errors_deg;
  std::vector<Vector3d> directions;  // of cam2_from_cam1
};

// How one sensor turned from one frame to another.
struct Turn {
  int frame1 = 0;  // < frame2
  int frame2 = 0;
  int sensor = 0;
  Quaterniond rotation;

  std::pair<int, int> Frames() const { return {frame1, frame2}; }
};

// Also where half of the pairs are wrong, a right rig has a small one.
double LowerQuartile(std::vector<double> values) {
  const auto nth = values.begin() + values.size() / 4;
  std::nth_element(values.begin(), nth, values.end());
  return *nth;
}

class RigComparison {
 public:
  RigComparison(const Scene& scene, const ViewGraph& view_graph)
      : scene_(scene) {
    for (const ImagePair& pair : view_graph.pairs) {
      if (pair.relative_pose) AddPair(pair);
    }
    AddTurns();
  }

  void Check() const {
    for (const auto& [sensors, samples] : frame_samples_) {
      if (samples.rotation_errors_deg.size() < kMinNumFrames) continue;
      const double error_deg = LowerQuartile(samples.rotation_errors_deg);
      if (error_deg > kMaxRotationDeg) {
        Throw(sensors, "rotation", error_deg,
              samples.rotation_errors_deg.size());
      }
      CheckDirections(sensors, samples.directions);
    }
    for (const auto& [sensors, errors] : turn_errors_) {
      if (errors.size() < kMinNumTurns) continue;
      const double error = LowerQuartile(errors);
      if (error > kMaxAxisError) {
        Throw(sensors, "rotation",
              RadToDeg(2.0 * std::asin(std::min(1.0, error))), errors.size());
      }
    }
  }

 private:
  void AddPair(const ImagePair& pair);
  void AddTurns();
  void CheckDirections(const SensorPair& sensors,
                       const std::vector<Vector3d>& directions) const;
  [[noreturn]] void Throw(const SensorPair& sensors, const char* what,
                          double error_deg, size_t num_samples) const;

  // Of two different sensors of one rig whose poses are both given.
  bool AreGiven(int sensor1, int sensor2) const {
    const Sensor& a = scene_.sensors[sensor1];
    const Sensor& b = scene_.sensors[sensor2];
    return sensor1 != sensor2 && a.rig_idx == b.rig_idx && a.sensor_from_rig &&
           b.sensor_from_rig;
  }
  Rigid3 Given(const SensorPair& sensors) const {
    return *scene_.sensors[sensors.second].sensor_from_rig *
           scene_.sensors[sensors.first].sensor_from_rig->Inverse();
  }

  const Scene& scene_;
  std::map<SensorPair, FrameSamples> frame_samples_;
  std::vector<Turn> turns_;
  std::map<SensorPair, std::vector<double>> turn_errors_;  // of axes
};

void RigComparison::AddPair(const ImagePair& pair) {
  const Image& image1 = scene_.images[pair.image_idx1];
  const Image& image2 = scene_.images[pair.image_idx2];
  const RelativePose& pose = *pair.relative_pose;
  if (image1.frame_idx != image2.frame_idx) {
    if (image1.sensor_idx != image2.sensor_idx) return;
    const bool is_forward = image1.frame_idx < image2.frame_idx;
    turns_.push_back(
        {std::min(image1.frame_idx, image2.frame_idx),
         std::max(image1.frame_idx, image2.frame_idx), image1.sensor_idx,
         is_forward ? pose.cam2_from_cam1 : pose.cam2_from_cam1.conjugate()});
    return;
  }
  if (!AreGiven(image1.sensor_idx, image2.sensor_idx)) return;
  const SensorPair sensors(image1.sensor_idx, image2.sensor_idx);
  FrameSamples& samples = frame_samples_[sensors];
  samples.rotation_errors_deg.push_back(
      RadToDeg(AngleBetween(Given(sensors).rotation, pose.cam2_from_cam1)));
  if (pose.translation_direction) {
    samples.directions.push_back(*pose.translation_direction);
  }
}

void RigComparison::AddTurns() {
  std::sort(turns_.begin(), turns_.end(), [](const Turn& a, const Turn& b) {
    return std::tie(a.frame1, a.frame2, a.sensor) <
           std::tie(b.frame1, b.frame2, b.sensor);
  });
  for (auto a = turns_.begin(); a != turns_.end(); ++a) {
    const double turn = AngleBetween(a->rotation, Quaterniond::Identity());
    if (turn < DegToRad(kMinTurnDeg)) continue;
    for (auto b = a + 1; b != turns_.end() && b->Frames() == a->Frames(); ++b) {
      if (!AreGiven(a->sensor, b->sensor)) continue;
      const SensorPair sensors(a->sensor, b->sensor);
      const Quaterniond b_from_a = Given(sensors).rotation;
      turn_errors_[sensors].push_back(
          AngleBetween(b_from_a * a->rotation * b_from_a.conjugate(),
                       b->rotation) /
          (2.0 * turn));
    }
  }
}

void RigComparison::CheckDirections(
    const SensorPair& sensors, const std::vector<Vector3d>& directions) const {
  const Vector3d given = Given(sensors).translation;
  if (directions.size() < kMinNumFrames || given.isZero(0.0)) return;
  Vector3d mean = Vector3d::Zero();
  for (const Vector3d& direction : directions) mean += direction;
  mean /= static_cast<double>(directions.size());
  if (mean.norm() < kMinMeanDirection) return;
  const double error_deg = RadToDeg(AngleBetween(given, mean));
  if (error_deg > kMaxDirectionDeg) {
    Throw(sensors, "direction of the translation", error_deg,
          directions.size());
  }
}

void RigComparison::Throw(const SensorPair& sensors, const char* what,
                          double error_deg, size_t num_samples) const {
  char number[32];
  std::snprintf(number, sizeof(number), "%.1f", error_deg);
  throw Error("the given " + std::string(what) + " between the cameras '" +
              scene_.sensors[sensors.first].name + "' and '" +
              scene_.sensors[sensors.second].name +
              "' of a rig contradicts the matches of " +
              std::to_string(num_samples) + " frames by " + number + " deg" +
              kRemedy);
}

}  // namespace

void CheckKnownRigs(const Scene& scene, const ViewGraph& view_graph) {
  RigComparison(scene, view_graph).Check();
}

}  // namespace mgsfm

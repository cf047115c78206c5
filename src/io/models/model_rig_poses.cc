// SPDX-License-Identifier: BSD-3-Clause
#include "models/model_rig_poses.h"

#include <algorithm>

#include "base/format.h"
#include "geometry/so3.h"
#include "math/statistics.h"
#include "mgsfm/base/error.h"
#include "scene/typical_pose.h"

namespace mgsfm {
namespace {

// A rigidly mounted camera rotates by noise only, far below this; cameras that
// move independently of each other exceed it in most frames.
constexpr double kMaxRigRotationDeg = 5.0;
// Calibrations of one rig differ less: a camera that turned by half of this is
// reported as moved. The shift is relative to the size of the rig.
constexpr double kMaxKnownRotationDeg = 1.0;
constexpr double kMaxKnownShift = 0.05;

}  // namespace

void ThrowModelError(const std::filesystem::path& folder,
                     const std::string& problem) {
  throw Error("model '" + folder.string() + "': " + problem);
}

void RigPoses::EstimateSensors(
    std::vector<std::optional<Rigid3>>* poses) const {
  FillMissing(poses);
  CheckAllAreKnown(*poses);
}

void RigPoses::CheckKnownSensors() const {
  std::vector<std::optional<Rigid3>> poses(scene_.sensors.size());
  for (const Rig& rig : scene_.rigs) poses[rig.ref_sensor_idx] = Rigid3();
  FillMissing(&poses);
  CheckKnownSensors(poses);
}

void RigPoses::CheckKnownSensors(
    const std::vector<std::optional<Rigid3>>& poses) const {
  std::vector<double> size(scene_.rigs.size(), 0.0);
  for (const Sensor& sensor : scene_.sensors) {
    if (!sensor.sensor_from_rig) continue;
    size[sensor.rig_idx] = std::max(size[sensor.rig_idx],
                                    sensor.sensor_from_rig->translation.norm());
  }
  for (size_t i = 0; i < scene_.sensors.size(); ++i) {
    const Sensor& sensor = scene_.sensors[i];
    if (!sensor.sensor_from_rig || !poses[i]) continue;
    const double turn_deg = RadToDeg(
        AngleBetween(poses[i]->rotation, sensor.sensor_from_rig->rotation));
    const double shift =
        (poses[i]->translation - sensor.sensor_from_rig->translation).norm();
    if (turn_deg <= kMaxKnownRotationDeg &&
        shift <= kMaxKnownShift * size[sensor.rig_idx]) {
      continue;
    }
    const std::string numbers = Formatted(
        "%.2f deg and a shift of %.4g (known: %.4g, in the model: %.4g)",
        turn_deg, shift, sensor.sensor_from_rig->translation.norm(),
        poses[i]->translation.norm());
    ThrowModelError(folder_,
                    "the known pose of camera '" + sensor.name +
                        "' in its rig differs from that of the model by " +
                        numbers +
                        "; make the model again with the known rig, or omit "
                        "the pose");
  }
}

void RigPoses::FillMissing(std::vector<std::optional<Rigid3>>* poses) const {
  for (size_t num_left = scene_.sensors.size(); num_left > 0; --num_left) {
    for (size_t i = 0; i < scene_.sensors.size(); ++i) {
      if ((*poses)[i]) continue;
      const int sensor_idx = static_cast<int>(i);
      const std::vector<Rigid3> candidates = Candidates(sensor_idx, *poses);
      if (candidates.empty()) continue;
      (*poses)[i] = TypicalPose(candidates);
      CheckMovesLikeRig(sensor_idx, candidates, *(*poses)[i]);
    }
  }
}

void RigPoses::CheckAllAreKnown(
    const std::vector<std::optional<Rigid3>>& poses) const {
  for (size_t i = 0; i < scene_.images.size(); ++i) {
    const int sensor_idx = scene_.images[i].sensor_idx;
    if (!cam_from_world_[i] || poses[sensor_idx]) continue;
    ThrowModelError(folder_,
                    "the pose of sensor '" + scene_.sensors[sensor_idx].name +
                        "' in its rig is unknown, as no frame has images of it "
                        "and of another sensor; give it with rig_config_path, "
                        "or treat images as single with rig_name_rule none");
  }
}

std::vector<Rigid3> RigPoses::Candidates(
    int sensor_idx, const std::vector<std::optional<Rigid3>>& poses) const {
  std::vector<Rigid3> candidates;
  for (const Frame& frame : scene_.frames) {
    std::optional<Rigid3> pose;
    std::optional<Rigid3> rig_from_world;
    for (const int image_idx : frame.image_idxs) {
      const int other_idx = scene_.images[image_idx].sensor_idx;
      const std::optional<Rigid3>& cam_from_world = cam_from_world_[image_idx];
      if (!cam_from_world) continue;
      if (other_idx == sensor_idx) {
        pose = cam_from_world;
      } else if (poses[other_idx] && !rig_from_world) {
        rig_from_world = poses[other_idx]->Inverse() * *cam_from_world;
      }
    }
    if (!pose || !rig_from_world) continue;
    candidates.push_back(*pose * rig_from_world->Inverse());
  }
  return candidates;
}

void RigPoses::CheckMovesLikeRig(int sensor_idx,
                                 const std::vector<Rigid3>& candidates,
                                 const Rigid3& pose) const {
  std::vector<double> angles_deg;
  for (const Rigid3& candidate : candidates) {
    angles_deg.push_back(
        RadToDeg(AngleBetween(candidate.rotation, pose.rotation)));
  }
  if (Median(angles_deg) < kMaxRigRotationDeg) return;
  ThrowModelError(
      folder_, "images of '" + scene_.sensors[sensor_idx].name +
                   "' rotate relative to the other images of their frames, so "
                   "the cameras are not rigid or the frames are wrong; define "
                   "the frames with rig_name_rule, or treat images as "
                   "single with rig_name_rule none");
}

std::vector<std::optional<Rigid3>> RigPoses::PlaceFrames(
    const std::vector<std::optional<Rigid3>>& sensor_from_rig) const {
  std::vector<std::optional<Rigid3>> rig_from_world;
  for (const Frame& frame : scene_.frames) {
    std::optional<int> best;
    for (const int image_idx : frame.image_idxs) {
      if (!cam_from_world_[image_idx]) continue;
      if (!best || scene_.IsReference(scene_.images[image_idx].sensor_idx)) {
        best = image_idx;
      }
    }
    rig_from_world.emplace_back();
    if (!best) continue;
    const Rigid3& sensor = *sensor_from_rig[scene_.images[*best].sensor_idx];
    rig_from_world.back() = sensor.Inverse() * *cam_from_world_[*best];
  }
  return rig_from_world;
}

}  // namespace mgsfm

// SPDX-License-Identifier: BSD-3-Clause
#include "io/models/model_rig_poses.h"

#include "geometry/so3.h"
#include "math/statistics.h"
#include "mgsfm/base/error.h"
#include "scene/typical_pose.h"

namespace mgsfm {
namespace {

// A rigidly mounted camera rotates by noise only, far below this; cameras that
// move independently of each other exceed it in most frames.
constexpr double kMaxRigRotationDeg = 5.0;

}  // namespace

void ThrowModelError(const std::filesystem::path& folder,
                     const std::string& problem) {
  throw Error("model '" + folder.string() + "': " + problem);
}

void RigPoses::EstimateSensors(
    std::vector<std::optional<Rigid3>>* poses) const {
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
  CheckAllAreKnown(*poses);
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

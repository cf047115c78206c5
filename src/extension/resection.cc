// SPDX-License-Identifier: BSD-3-Clause
#include "mgsfm/extension/resection.h"

#include <algorithm>
#include <optional>
#include <utility>

#include "base/parallel.h"
#include "extension/point_matches.h"
#include "geometry/absolute_pose.h"
#include "mgsfm/base/error.h"
#include "mgsfm/base/mask.h"
#include "mgsfm/base/random.h"
#include "mgsfm/geometry/camera_models.h"
#include "scene/typical_pose.h"

namespace mgsfm {
namespace {

// A pose of a unit, or of one image, and how many keypoints agree with it.
struct UnitPose {
  std::optional<Rigid3> unit_from_world;
  int num_keypoints = 0;
  int num_inliers = 0;
};

class FrameResector {
 public:
  FrameResector(const Scene& scene, const Bearings& bearings,
                const ViewGraph& view_graph, const Reconstruction& model,
                const ResectionOptions& options, const Context& context)
      : scene_(scene),
        bearings_(bearings),
        model_(model),
        options_(options),
        context_(context) {
    result_.estimate = model;
    Mask is_wanted(scene.images.size());
    for (size_t i = 0; i < is_wanted.size(); ++i) {
      is_wanted[i] = !model.IsRegistered(scene, static_cast<int>(i));
    }
    matches_ = FindPointMatches(scene, view_graph, model, is_wanted,
                                context.num_threads);
  }

  ResectionResult Run() {
    PlaceSensors();
    PlaceFrames();
    return std::move(result_);
  }

 private:
  void PlaceSensors();
  void ResectSingleImages();
  bool PlaceSensor(int sensor_idx);
  std::optional<Rigid3> RigFromWorld(const Frame& frame) const;
  void PlaceFrames();
  CameraPoints PointsOf(int image_idx, const Rigid3& cam_from_unit) const;
  UnitPose Resect(const std::vector<CameraPoints>& cameras,
                  uint64_t stream) const;

  const Scene& scene_;
  const Bearings& bearings_;
  const Reconstruction& model_;
  const ResectionOptions& options_;
  const Context& context_;
  std::vector<std::vector<PointMatch>> matches_;  // per image without pose
  std::vector<UnitPose> single_;  // cam_from_world, of rigs to be calibrated
  ResectionResult result_;
};

CameraPoints FrameResector::PointsOf(int image_idx,
                                     const Rigid3& cam_from_unit) const {
  const Camera& camera = scene_.cameras[scene_.images[image_idx].camera_idx];
  CameraPoints result{cam_from_unit, {}, {}, 0.0};
  result.max_error_rad = options_.abs_pose_max_error_px /
                         PixelsPerRadian(camera.model, camera.params.data());
  for (const PointMatch& match : matches_[image_idx]) {
    if (!bearings_.HasRay(image_idx, match.keypoint_idx)) continue;
    result.rays.push_back(bearings_.Ray(image_idx, match.keypoint_idx));
    result.points.push_back(model_.points[match.point_idx].point_in_world);
  }
  return result;
}

UnitPose FrameResector::Resect(const std::vector<CameraPoints>& cameras,
                               uint64_t stream) const {
  UnitPose result;
  for (const CameraPoints& camera : cameras) {
    result.num_keypoints += static_cast<int>(camera.size());
  }
  if (result.num_keypoints < options_.abs_pose_min_num_inliers) return result;
  RansacOptions ransac;
  ransac.max_num_trials = options_.abs_pose_max_num_trials;
  ransac.min_num_trials =
      std::min(ransac.min_num_trials, ransac.max_num_trials);
  Random random(context_.random_seed, stream);
  const auto pose = EstimateAbsolutePose(cameras, ransac, &random);
  if (!pose) return result;
  result.num_inliers = ScoreAbsolutePose(cameras, *pose).num_inliers;
  if (result.num_inliers >= options_.abs_pose_min_num_inliers &&
      result.num_inliers >=
          options_.abs_pose_min_inlier_ratio * result.num_keypoints) {
    result.unit_from_world = pose;
  }
  return result;
}

// ------------------------------------------------------------------ sensors

void FrameResector::PlaceSensors() {
  std::vector<int> unknown;
  for (size_t i = 0; i < scene_.sensors.size(); ++i) {
    std::optional<Rigid3>& pose = result_.estimate.sensor_from_rig[i];
    if (pose) continue;
    pose = scene_.sensors[i].sensor_from_rig;  // given, or the reference
    if (!pose) unknown.push_back(static_cast<int>(i));
  }
  if (unknown.empty()) return;
  ResectSingleImages();
  for (bool is_placed = true; is_placed;) {
    is_placed = false;
    for (const int sensor_idx : unknown) {
      if (result_.estimate.sensor_from_rig[sensor_idx]) continue;
      is_placed = PlaceSensor(sensor_idx) || is_placed;
    }
  }
}

// Of rigs with a sensor that has no pose.
void FrameResector::ResectSingleImages() {
  Mask rig_is_known(scene_.rigs.size(), true);
  for (size_t i = 0; i < scene_.sensors.size(); ++i) {
    if (result_.estimate.sensor_from_rig[i]) continue;
    rig_is_known[scene_.sensors[i].rig_idx] = false;
  }
  single_.resize(scene_.images.size());
  ParallelFor(
      scene_.images.size(), context_.num_threads,
      [&](size_t i) {
        const int image_idx = static_cast<int>(i);
        const Image& image = scene_.images[i];
        if (rig_is_known[scene_.frames[image.frame_idx].rig_idx]) return;
        // Streams of images and of frames differ.
        single_[i] = Resect({PointsOf(image_idx, Rigid3())}, 2 * i);
      },
      1);
}

// Where the rig is by the images of sensors that have a pose: by that of the
// model, else by the image that agrees with the most points.
std::optional<Rigid3> FrameResector::RigFromWorld(const Frame& frame) const {
  const int frame_idx = scene_.images[frame.image_idxs.front()].frame_idx;
  if (model_.rig_from_world[frame_idx]) return model_.rig_from_world[frame_idx];
  std::optional<Rigid3> rig_from_world;
  int most = 0;
  for (const int image_idx : frame.image_idxs) {
    const UnitPose& single = single_[image_idx];
    const auto& sensor =
        result_.estimate.sensor_from_rig[scene_.images[image_idx].sensor_idx];
    if (!sensor || !single.unit_from_world || single.num_inliers <= most) {
      continue;
    }
    most = single.num_inliers;
    rig_from_world = sensor->Inverse() * *single.unit_from_world;
  }
  return rig_from_world;
}

bool FrameResector::PlaceSensor(int sensor_idx) {
  std::vector<Rigid3> poses;
  for (const Frame& frame : scene_.frames) {
    if (frame.rig_idx != scene_.sensors[sensor_idx].rig_idx) continue;
    for (const int image_idx : frame.image_idxs) {
      const auto& cam_from_world = single_[image_idx].unit_from_world;
      if (scene_.images[image_idx].sensor_idx != sensor_idx) continue;
      if (!cam_from_world) continue;
      const auto rig_from_world = RigFromWorld(frame);
      if (!rig_from_world) continue;
      poses.push_back(*cam_from_world * rig_from_world->Inverse());
    }
  }
  if (poses.empty()) return false;
  result_.estimate.sensor_from_rig[sensor_idx] = TypicalPose(poses);
  result_.sensors.push_back({sensor_idx, static_cast<int>(poses.size())});
  return true;
}

// ------------------------------------------------------------------- frames

void FrameResector::PlaceFrames() {
  for (size_t i = 0; i < scene_.frames.size(); ++i) {
    if (!model_.rig_from_world[i]) {
      result_.frames.push_back({static_cast<int>(i)});
    }
  }
  ParallelFor(
      result_.frames.size(), context_.num_threads,
      [&](size_t i) {
        ResectedFrame& frame = result_.frames[i];
        std::vector<CameraPoints> cameras;
        for (const int image_idx : scene_.frames[frame.frame_idx].image_idxs) {
          const auto& sensor =
              result_.estimate
                  .sensor_from_rig[scene_.images[image_idx].sensor_idx];
          if (sensor) cameras.push_back(PointsOf(image_idx, *sensor));
        }
        const UnitPose pose =
            Resect(cameras, 2 * static_cast<uint64_t>(frame.frame_idx) + 1);
        frame.num_images = static_cast<int>(cameras.size());
        frame.num_keypoints = pose.num_keypoints;
        frame.num_inliers = pose.num_inliers;
        frame.is_added = pose.unit_from_world.has_value();
        result_.estimate.rig_from_world[frame.frame_idx] = pose.unit_from_world;
      },
      1,
      [&](size_t num_done) {
        context_.ReportProgress("resection", num_done, result_.frames.size());
      });
}

}  // namespace

ResectionResult ResectFrames(const Scene& scene, const Bearings& bearings,
                             const ViewGraph& view_graph,
                             const Reconstruction& model,
                             const ResectionOptions& options,
                             const Context& context) {
  MGSFM_CHECK_EQ(model.rig_from_world.size(), scene.frames.size());
  MGSFM_CHECK_EQ(model.sensor_from_rig.size(), scene.sensors.size());
  return FrameResector(scene, bearings, view_graph, model, options, context)
      .Run();
}

}  // namespace mgsfm

// SPDX-License-Identifier: BSD-3-Clause
#include <algorithm>
#include <optional>

#include "base/parallel.h"
#include "base/random.h"
#include "geometry/absolute_pose.h"
#include "mgsfm/base/error.h"
#include "mgsfm/base/mask.h"
#include "mgsfm/geometry/camera_models.h"
#include "mgsfm/registration/model_extension.h"
#include "registration/unit_resection.h"
#include "scene/point_lookup.h"
#include "scene/typical_pose.h"

namespace mgsfm {
namespace {

using Votes = std::vector<std::pair<int, int>>;  // keypoint, point

// The point with the most votes, per keypoint. Sorts the votes.
std::vector<PointMatch> CountVotes(Votes* votes) {
  std::sort(votes->begin(), votes->end());
  std::vector<PointMatch> matches;
  size_t most = 0;
  for (size_t begin = 0, end = 0; begin < votes->size(); begin = end) {
    const auto& [keypoint_idx, point_idx] = (*votes)[begin];
    while (end < votes->size() && (*votes)[end] == (*votes)[begin]) ++end;
    const bool is_new =
        matches.empty() || matches.back().keypoint_idx != keypoint_idx;
    if (is_new) {
      matches.push_back({keypoint_idx, point_idx});
    } else if (end - begin > most) {
      matches.back().point_idx = point_idx;
    } else {
      continue;
    }
    most = end - begin;
  }
  return matches;
}

// The constant inputs of all resections.
struct ResectionInput {
  const Scene& scene;
  const Bearings& bearings;
  const Reconstruction& model;
  const ResectionOptions& options;
  const Context& context;
  std::vector<std::vector<PointMatch>> matches;  // per image without pose
};

using SensorPoses = std::vector<std::optional<Rigid3>>;  // sensor_from_rig

// Single images and frames use different random streams.
uint64_t StreamOfImage(size_t image_idx) { return 2 * image_idx; }
uint64_t StreamOfFrame(int frame_idx) {
  return 2 * static_cast<uint64_t>(frame_idx) + 1;
}

std::vector<std::vector<PointMatch>> MatchUnregisteredImages(
    const Scene& scene, const ViewGraph& view_graph,
    const Reconstruction& model, int num_threads) {
  Mask is_wanted(scene.images.size());
  for (size_t i = 0; i < is_wanted.size(); ++i) {
    is_wanted[i] = !model.IsRegistered(scene, static_cast<int>(i));
  }
  return FindPointMatches(scene, view_graph, model, is_wanted, num_threads);
}

CameraPoints PointsOf(const ResectionInput& input, int image_idx,
                      const Rigid3& cam_from_unit) {
  const Camera& camera =
      input.scene.cameras[input.scene.images[image_idx].camera_idx];
  CameraPoints result = CollectPoints(input.bearings, input.model, image_idx,
                                      input.matches[image_idx]);
  result.cam_from_unit = cam_from_unit;
  result.max_error_rad =
      input.options.abs_pose_max_error_px / PixelsPerRadian(camera);
  return result;
}

// ------------------------------------------------------------------ sensors

// cam_from_world of each image of a rig with an uncalibrated sensor.
std::vector<UnitPose> ResectSingleImages(const ResectionInput& input,
                                         const SensorPoses& sensor_from_rig) {
  const Scene& scene = input.scene;
  Mask rig_is_calibrated(scene.rigs.size(), true);
  for (size_t i = 0; i < scene.sensors.size(); ++i) {
    if (!sensor_from_rig[i])
      rig_is_calibrated[scene.sensors[i].rig_idx] = false;
  }
  std::vector<UnitPose> poses(scene.images.size());
  ParallelFor(
      scene.images.size(), input.context.num_threads,
      [&](size_t i) {
        const Image& image = scene.images[i];
        if (rig_is_calibrated[scene.frames[image.frame_idx].rig_idx]) return;
        poses[i] = ResectUnit({PointsOf(input, static_cast<int>(i), Rigid3())},
                              input.options, input.context.random_seed,
                              StreamOfImage(i));
      },
      1);
  return poses;
}

// The pose of a frame in the model; otherwise, the pose implied by its
// calibrated image with the most inliers.
std::optional<Rigid3> FindRigFromWorld(const ResectionInput& input,
                                       const Frame& frame,
                                       const SensorPoses& sensor_from_rig,
                                       const std::vector<UnitPose>& images) {
  const Scene& scene = input.scene;
  const int frame_idx = scene.images[frame.image_idxs.front()].frame_idx;
  if (input.model.rig_from_world[frame_idx]) {
    return input.model.rig_from_world[frame_idx];
  }
  std::optional<Rigid3> rig_from_world;
  int max_num_inliers = 0;
  for (const int image_idx : frame.image_idxs) {
    const UnitPose& image = images[image_idx];
    const auto& sensor = sensor_from_rig[scene.images[image_idx].sensor_idx];
    if (!sensor || !image.unit_from_world ||
        image.num_inliers <= max_num_inliers) {
      continue;
    }
    max_num_inliers = image.num_inliers;
    rig_from_world = sensor->Inverse() * *image.unit_from_world;
  }
  return rig_from_world;
}

// One estimate of sensor_from_rig per frame that has both poses.
std::vector<Rigid3> FindSensorPoses(const ResectionInput& input, int sensor_idx,
                                    const SensorPoses& sensor_from_rig,
                                    const std::vector<UnitPose>& images) {
  const Scene& scene = input.scene;
  std::vector<Rigid3> poses;
  for (const Frame& frame : scene.frames) {
    if (frame.rig_idx != scene.sensors[sensor_idx].rig_idx) continue;
    for (const int image_idx : frame.image_idxs) {
      const auto& cam_from_world = images[image_idx].unit_from_world;
      if (scene.images[image_idx].sensor_idx != sensor_idx) continue;
      if (!cam_from_world) continue;
      const auto rig_from_world =
          FindRigFromWorld(input, frame, sensor_from_rig, images);
      if (!rig_from_world) continue;
      poses.push_back(*cam_from_world * rig_from_world->Inverse());
    }
  }
  return poses;
}

// Completes the rig extrinsics: known sensors first, then, by resection, each
// further sensor that can be connected to those before.
std::vector<PlacedSensor> CalibrateSensors(const ResectionInput& input,
                                           SensorPoses* sensor_from_rig) {
  std::vector<int> unknown;
  for (size_t i = 0; i < sensor_from_rig->size(); ++i) {
    std::optional<Rigid3>& pose = (*sensor_from_rig)[i];
    if (pose) continue;
    pose = input.scene.sensors[i].sensor_from_rig;
    if (!pose) unknown.push_back(static_cast<int>(i));
  }
  std::vector<PlacedSensor> placed;
  if (unknown.empty()) return placed;
  const std::vector<UnitPose> images =
      ResectSingleImages(input, *sensor_from_rig);
  for (bool has_changed = true; has_changed;) {
    has_changed = false;
    for (const int sensor_idx : unknown) {
      if ((*sensor_from_rig)[sensor_idx]) continue;
      const std::vector<Rigid3> poses =
          FindSensorPoses(input, sensor_idx, *sensor_from_rig, images);
      if (poses.empty()) continue;
      (*sensor_from_rig)[sensor_idx] = TypicalPose(poses);
      placed.push_back({sensor_idx, static_cast<int>(poses.size())});
      has_changed = true;
    }
  }
  return placed;
}

// ------------------------------------------------------------------- frames

// Resects one frame; returns its pose if it is registered.
std::optional<Rigid3> ResectFrame(const ResectionInput& input,
                                  const SensorPoses& sensor_from_rig,
                                  ResectedFrame* frame) {
  const Scene& scene = input.scene;
  std::vector<CameraPoints> cameras;
  for (const int image_idx : scene.frames[frame->frame_idx].image_idxs) {
    const auto& sensor = sensor_from_rig[scene.images[image_idx].sensor_idx];
    if (sensor) cameras.push_back(PointsOf(input, image_idx, *sensor));
  }
  const UnitPose pose =
      ResectUnit(cameras, input.options, input.context.random_seed,
                 StreamOfFrame(frame->frame_idx));
  frame->num_images = static_cast<int>(cameras.size());
  frame->num_keypoints = pose.num_keypoints;
  frame->num_inliers = pose.num_inliers;
  frame->is_added = pose.unit_from_world.has_value();
  return pose.unit_from_world;
}

}  // namespace

std::vector<std::vector<PointMatch>> FindPointMatches(
    const Scene& scene, const ViewGraph& view_graph,
    const Reconstruction& model, const Mask& is_wanted, int num_threads) {
  const PointLookup lookup(scene, model);
  std::vector<Votes> votes(scene.images.size());
  for (const ImagePair& pair : view_graph.pairs) {
    if (is_wanted[pair.image_idx1]) {
      for (const Match& match : pair.matches) {
        const std::optional<int> point =
            lookup.Find(pair.image_idx2, match.keypoint_idx2);
        if (!point) continue;
        votes[pair.image_idx1].emplace_back(match.keypoint_idx1, *point);
      }
    }
    if (is_wanted[pair.image_idx2]) {
      for (const Match& match : pair.matches) {
        const std::optional<int> point =
            lookup.Find(pair.image_idx1, match.keypoint_idx1);
        if (!point) continue;
        votes[pair.image_idx2].emplace_back(match.keypoint_idx2, *point);
      }
    }
  }
  std::vector<std::vector<PointMatch>> matches(scene.images.size());
  ParallelFor(scene.images.size(), num_threads,
              [&](size_t i) { matches[i] = CountVotes(&votes[i]); });
  return matches;
}

CameraPoints CollectPoints(const Bearings& bearings,
                           const Reconstruction& model, int image_idx,
                           const std::vector<PointMatch>& matches) {
  CameraPoints result;
  for (const PointMatch& match : matches) {
    if (!bearings.HasRay(image_idx, match.keypoint_idx)) continue;
    result.rays.push_back(bearings.Ray(image_idx, match.keypoint_idx));
    result.points.push_back(model.points[match.point_idx].point_in_world);
  }
  return result;
}

UnitPose ResectUnit(const std::vector<CameraPoints>& cameras,
                    const ResectionOptions& options, uint64_t seed,
                    uint64_t stream) {
  UnitPose result;
  for (const CameraPoints& camera : cameras) {
    result.num_keypoints += static_cast<int>(camera.size());
  }
  if (result.num_keypoints < options.abs_pose_min_num_inliers) return result;
  RansacOptions ransac;
  ransac.max_num_trials = options.abs_pose_max_num_trials;
  ransac.min_num_trials =
      std::min(ransac.min_num_trials, ransac.max_num_trials);
  Random random(seed, stream);
  const auto pose = EstimateAbsolutePose(cameras, ransac, &random);
  if (!pose) return result;
  result.num_inliers = ScoreAbsolutePose(cameras, *pose).num_inliers;
  if (result.num_inliers >= options.abs_pose_min_num_inliers &&
      result.num_inliers >=
          options.abs_pose_min_inlier_ratio * result.num_keypoints) {
    result.unit_from_world = pose;
  }
  return result;
}

ResectionResult ResectFrames(const Scene& scene, const Bearings& bearings,
                             const ViewGraph& view_graph,
                             const Reconstruction& model,
                             const ResectionOptions& options,
                             const Context& context) {
  MGSFM_CHECK_EQ(model.rig_from_world.size(), scene.frames.size());
  MGSFM_CHECK_EQ(model.sensor_from_rig.size(), scene.sensors.size());
  const ResectionInput input{
      scene,
      bearings,
      model,
      options,
      context,
      MatchUnregisteredImages(scene, view_graph, model, context.num_threads)};
  ResectionResult result;
  result.estimate = model;
  result.sensors = CalibrateSensors(input, &result.estimate.sensor_from_rig);
  for (size_t i = 0; i < scene.frames.size(); ++i) {
    if (!model.rig_from_world[i]) {
      result.frames.push_back({static_cast<int>(i)});
    }
  }
  ParallelFor(
      result.frames.size(), context.num_threads,
      [&](size_t i) {
        ResectedFrame& frame = result.frames[i];
        result.estimate.rig_from_world[frame.frame_idx] =
            ResectFrame(input, result.estimate.sensor_from_rig, &frame);
      },
      1,
      [&](size_t num_done) {
        context.ReportProgress("resection", num_done, result.frames.size());
      });
  return result;
}

}  // namespace mgsfm

// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <vector>

#include "mgsfm/base/context.h"
#include "mgsfm/base/fields.h"
#include "mgsfm/base/options.h"
#include "mgsfm/scene/estimates.h"
#include "mgsfm/scene/scene.h"
#include "mgsfm/scene/view_graph.h"

namespace mgsfm {

// Registers frames to a model by resection from its points. Each frame is one
// rigid unit with 6 unknowns: its pose is the one with the most inliers over
// the keypoints of all its images (LO-RANSAC, geometry/absolute_pose.h), so
// that cameras with few points, or none, are registered as well. The model is
// fixed.
//
// A keypoint observes the point that most of its matches in registered images
// observe.
//
// Sensors without pose in the model, such as those of a new rig, are calibrated
// first. The images of their rigs are resected individually; each frame with
// poses of two sensors yields a relative pose, and sensor_from_rig is the
// median of these (scene/typical_pose.h), starting at the reference sensor.
//
// RANSAC stops at the default confidence of RansacOptions or after
// abs_pose_max_num_trials samples. Cost: linear in the number of matches, plus
// one pass over the keypoints of a frame per sample. Frames run in parallel.

struct ResectionOptions {
  // Maximum reprojection error of an inlier in absolute pose estimation.
  // Increase it for images of very high resolution.
  double abs_pose_max_error_px = 12.0;
  // Minimum number of inliers, over all images of a frame, to register it.
  int abs_pose_min_num_inliers = 30;
  // The same for frames that growth adds next to their neighbors in a sequence,
  // over points that these observe (docs/maths/incremental.md).
  int abs_pose_min_num_neighbor_inliers = 10;
  // Minimum inlier ratio, over all images of a frame, to register it.
  double abs_pose_min_inlier_ratio = 0.25;
  // Maximum number of RANSAC trials per frame.
  int abs_pose_max_num_trials = 2000;
};

// A frame without pose in the model.
struct ResectedFrame {
  int frame_idx = 0;
  bool is_added = false;
  int num_images = 0;     // images of calibrated sensors
  int num_keypoints = 0;  // their keypoints matched to points
  int num_inliers = 0;

  auto Fields() const {
    return Named("frame_id", As<Item::kFrameId>(frame_idx), "name",
                 As<Item::kFrameName>(frame_idx), "num_keypoints",
                 num_keypoints, "num_inliers", num_inliers);
  }
};

// A sensor whose pose in the rig was estimated by resection.
struct PlacedSensor {
  int sensor_idx = 0;
  int num_frames = 0;  // frames that contributed a relative pose

  auto Fields() const {
    return Named("sensor", As<Item::kSensorName>(sensor_idx), "num_frames",
                 num_frames);
  }
};

struct ResectionResult {
  Reconstruction estimate;            // the model with new frames and sensors
  std::vector<ResectedFrame> frames;  // all frames without pose in the model
  std::vector<PlacedSensor> sensors;
};

[[nodiscard]] ResectionResult ResectFrames(const Scene& scene,
                                           const Bearings& bearings,
                                           const ViewGraph& view_graph,
                                           const Reconstruction& model,
                                           const ResectionOptions& options,
                                           const Context& context);

// Model extension adds the frames of a scene that an existing model lacks.
//
// 1. Only pairs with an image that the model lacks are verified and judged, as
//    in incremental mapping, and two spanning forests of the others, which give
//    the rules the relative placement of the frames of the model. The points of
//    the model stand for the matches that made them: tracks of the new pairs
//    are joined with the points that share a keypoint (JoinPoints()). Models
//    that have no points, or all images, use all pairs.
// 2. The model grows by one frame at a time, as in incremental mapping
//    (mgsfm/incremental/incremental_mapping.h).
// 3. Bundle adjustment of all frames, as in the mapper, but with a single round
//    of solve and triangulation, as all poses are near the optimum.
//
// Gauge: that of the existing model. Unless poses are fixed, the result is
// aligned to the existing model by the similarity that fits the image poses, or
// by a rigid transform if known sensor poses determine the unit of length.
//
// Cost: a pass over all matches; verification and an iteration of averaging are
// linear in the pairs of new images and the images of the model, tracks in the
// matches of new images, steps in the observations of six frames; bundle
// adjustment, which converges in few iterations, in the observations of the
// model.

struct ExtensionOptions {
  Option<bool> fix_existing_frames{
      "fix_existing_frames", false,
      "Fix the frames of the existing model and the sensors of its rigs."};
  ResectionOptions resection;

  template <class Visitor>
  void Describe(Visitor& visit) {
    visit(fix_existing_frames);
  }
};

struct ExtensionSummary {
  int num_existing_frames = 0;
  bool frames_are_fixed = false;
  std::vector<ResectedFrame> added_frames;  // in the order of their addition
  std::vector<PlacedSensor> placed_sensors;

  auto Fields() const {
    return Named("num_existing_frames", num_existing_frames, "frames_are_fixed",
                 frames_are_fixed, "added_frames", added_frames);
  }
};

}  // namespace mgsfm

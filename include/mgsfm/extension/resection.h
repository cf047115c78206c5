// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <vector>

#include "mgsfm/base/context.h"
#include "mgsfm/base/options.h"
#include "mgsfm/scene/estimates.h"
#include "mgsfm/scene/scene.h"
#include "mgsfm/scene/view_graph.h"

namespace mgsfm {

// Adds frames to a model, each by itself, from the points of the model that its
// images see. The whole frame is one rigid unit: its pose is that which the
// most keypoints of all its images agree with (geometry/absolute_pose.h), so
// that cameras with few points, or none, come along.
//
// A keypoint sees the point that the most of its matches in images of the model
// are observations of.
//
// Sensors without pose in the model, as those of a rig that is new to it, are
// placed first: their images, and those of the other sensors of their rig, are
// resected one by one; each frame in which two got a pose tells where one is
// relative to the other, and the typical of these poses is taken
// (scene/typical_pose.h), from the reference sensor on.
//
// Cost: linear in the matches; for each frame, a few hundred samples at worst,
// each with a pass over its keypoints. Frames are independent.

struct ResectionOptions {
  double abs_pose_max_error_px = 12.0;
  int abs_pose_min_num_inliers = 30;
  double abs_pose_min_inlier_ratio = 0.25;
  int abs_pose_max_num_trials = 2000;

  template <class Self, class Visitor>
  static void Describe(Self& self, Visitor& visit) {
    visit("abs_pose_max_error", self.abs_pose_max_error_px, GreaterThan(0.0),
          "px",
          "Keypoints farther from their points do not agree with the pose of "
          "a new frame.");
    visit("abs_pose_min_num_inliers", self.abs_pose_min_num_inliers, AtLeast(4),
          "keypoints",
          "New frames are added if so many keypoints of their images agree.");
    visit("abs_pose_min_inlier_ratio", self.abs_pose_min_inlier_ratio,
          Between(0.0, 1.0), "",
          "The same, as a share of those that are matched to points.");
    visit("abs_pose_max_num_trials", self.abs_pose_max_num_trials, AtLeast(1),
          "trials", "Most samples to draw for a frame.");
  }
};

// A frame that had no pose.
struct ResectedFrame {
  int frame_idx = 0;
  bool is_added = false;
  int num_images = 0;     // of sensors whose pose is known
  int num_keypoints = 0;  // of these, matched to points of the model
  int num_inliers = 0;
};

// A sensor that had no pose.
struct PlacedSensor {
  int sensor_idx = 0;
  int num_frames = 0;  // that told its pose
};

struct ResectionResult {
  Reconstruction estimate;  // the model with what was added
  std::vector<ResectedFrame> frames;
  std::vector<PlacedSensor> sensors;  // that have a pose now
};

[[nodiscard]] ResectionResult ResectFrames(const Scene& scene,
                                           const Bearings& bearings,
                                           const ViewGraph& view_graph,
                                           const Reconstruction& model,
                                           const ResectionOptions& options,
                                           const Context& context);

}  // namespace mgsfm

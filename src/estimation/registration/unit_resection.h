// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <cstdint>
#include <optional>
#include <vector>

#include "geometry/absolute_pose.h"
#include "mgsfm/base/mask.h"
#include "mgsfm/geometry/rigid3.h"
#include "mgsfm/registration/model_extension.h"
#include "mgsfm/scene/estimates.h"
#include "mgsfm/scene/scene.h"
#include "mgsfm/scene/view_graph.h"

namespace mgsfm {

// A keypoint of an image and the point that it observes.
struct PointMatch {
  int keypoint_idx = 0;
  int point_idx = 0;
};

// For each image with `is_wanted`, the keypoints matched to observations of
// points, in ascending order, each with the point of most of its matches; ties
// go to the smaller index. Cost: linear in the number of matches, plus sorting.
std::vector<std::vector<PointMatch>> FindPointMatches(
    const Scene& scene, const ViewGraph& view_graph,
    const Reconstruction& model, const Mask& is_wanted, int num_threads);

// The rays of these keypoints and their points in a model.
[[nodiscard]] CameraPoints CollectPoints(
    const Bearings& bearings, const Reconstruction& model, int image_idx,
    const std::vector<PointMatch>& matches);

// The pose of a rigid unit (a frame or a single image) and its support.
struct UnitPose {
  std::optional<Rigid3> unit_from_world;
  int num_keypoints = 0;
  int num_inliers = 0;
};

// LO-RANSAC (geometry/absolute_pose.h) with the random numbers of a stream. No
// pose unless its inliers satisfy the options.
[[nodiscard]] UnitPose ResectUnit(const std::vector<CameraPoints>& cameras,
                                  const ResectionOptions& options,
                                  uint64_t seed, uint64_t stream);

}  // namespace mgsfm

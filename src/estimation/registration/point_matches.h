// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <vector>

#include "mgsfm/base/mask.h"
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

}  // namespace mgsfm

// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <vector>

#include "mgsfm/base/mask.h"
#include "mgsfm/scene/estimates.h"
#include "mgsfm/scene/scene.h"
#include "mgsfm/scene/view_graph.h"

namespace mgsfm {

// A keypoint of an image and the point that it sees.
struct PointMatch {
  int keypoint_idx = 0;
  int point_idx = 0;
};

// Per image for which `is_wanted` is set: its keypoints that are matched to
// observations of points, ascending, each with the point that most of these
// matches are of, ties to the first. Linear in the matches, but for sorting.
std::vector<std::vector<PointMatch>> FindPointMatches(
    const Scene& scene, const ViewGraph& view_graph,
    const Reconstruction& model, const Mask& is_wanted, int num_threads);

}  // namespace mgsfm

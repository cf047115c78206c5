// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <optional>
#include <utility>
#include <vector>

#include "mgsfm/scene/estimates.h"
#include "mgsfm/scene/scene.h"
#include "mgsfm/scene/view_graph.h"
#include "pair_filtering/frame_pair_index.h"

namespace mgsfm {

// Finds where a model contradicts the motion of the rig: neighbours in time
// whose distance differs from the expected one by more than half of the larger
// of both, and by more than a typical step. A cut that few correct pairs cross
// can leave the distance open, and a wrong pair decides it.
//
// `expected_length` per pair of the view graph, in one unit, which is the
// median ratio of distances in the model and expected ones. Of the image pairs
// of equal sensors, the median counts. Empty without expected lengths.
// Cost: linear in the pairs.
[[nodiscard]] std::vector<std::pair<int, int>> FindMotionJumps(
    const Scene& scene, const FramePairIndex& index,
    const ViewGraph& view_graph,
    const std::vector<std::optional<double>>& expected_length,
    const Reconstruction& reconstruction);

}  // namespace mgsfm

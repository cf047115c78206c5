// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <vector>

#include "mgsfm/scene/view_graph.h"
#include "mgsfm/tracks/match_selection.h"
#include "tracks/match_graph.h"

namespace mgsfm::internal {

// Per match of all pairs: whether it is used and a bridge of the graph of
// keypoints and matches, that is, alone in holding its two sides together.
//
// Depth-first search (Tarjan 1974) without recursion: O(keypoints + matches) in
// time and memory.
std::vector<char> FindBridges(const KeypointNodes& nodes,
                              const ViewGraph& view_graph,
                              const MatchSelection& selection);

}  // namespace mgsfm::internal

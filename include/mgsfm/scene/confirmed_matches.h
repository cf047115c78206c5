// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <vector>

#include "mgsfm/scene/view_graph.h"

namespace mgsfm {

// Of each pair: its matches that a third image confirms, which has a keypoint
// that is matched with both. Neighbours on a path have many; a pair of
// unrelated places, however many matches agree on its motion, has none but by
// chance. Only matches of the pairs that pair_is_used names count; 0 elsewhere.
// Cost: linear in the matches times the length of tracks.
std::vector<int> CountConfirmedMatches(const ViewGraph& view_graph,
                                       const std::vector<char>& pair_is_used);

}  // namespace mgsfm

// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <vector>

#include "mgsfm/base/mask.h"
#include "mgsfm/scene/view_graph.h"

namespace mgsfm {

// A match is confirmed if a third image has a keypoint that is matched with
// both of its keypoints. Neighbours on a path have many such matches; a pair of
// unrelated places, however many matches agree on its motion, has none but by
// chance. Only the pairs that pair_is_used names count, false or 0 elsewhere.
// Cost: linear in the matches times the length of tracks.

// Per match of all pairs, one pair after the other.
Mask FindTripletConsistentMatches(const ViewGraph& view_graph,
                                  const Mask& pair_is_used,
                                  int num_threads = 1);

// Per pair.
std::vector<int> CountTripletConsistentMatches(const ViewGraph& view_graph,
                                               const Mask& pair_is_used,
                                               int num_threads = 1);

}  // namespace mgsfm

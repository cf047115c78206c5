// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <vector>

#include "mgsfm/base/context.h"
#include "mgsfm/base/mask.h"
#include "mgsfm/scene/pair_matches.h"
#include "mgsfm/scene/view_graph.h"

namespace mgsfm {

// A match is triplet-consistent if a keypoint of a third image is matched with
// both of its keypoints (after Zach, Klopschitz and Pollefeys, CVPR 2010).
// Neighbors on a path have many such matches. A pair of unrelated places has
// such matches only by chance, even if many of its matches agree on a relative
// pose. Only pairs in `pair_is_used` take part; false or 0 for all others.
// Cost: linear in the number of matches times the length of tracks.

// Per match of all pairs, one pair after the other.
Mask FindTripletConsistentMatches(const ViewGraph& view_graph,
                                  const Mask& pair_is_used,
                                  int num_threads = 1);

// Per pair.
std::vector<int> CountTripletConsistentMatches(const ViewGraph& view_graph,
                                               const Mask& pair_is_used,
                                               int num_threads = 1);

// The same for sorted pairs that are all used: one thread visits the triangles
// of images. This needs one bit per match instead of 8 bytes per match and 16
// bytes per keypoint, but a binary search per match and triangle. Sorts the
// matches of each pair.
std::vector<int> CountTripletConsistentMatches(std::vector<PairMatches>* pairs,
                                               const Context& context);

}  // namespace mgsfm

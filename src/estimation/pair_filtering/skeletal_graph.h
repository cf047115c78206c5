// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <vector>

#include "mgsfm/base/mask.h"
#include "mgsfm/pair_filtering/pair_filtering.h"
#include "pair_filtering/frame_pair_index.h"

namespace mgsfm {

// A sparse subgraph of pairs of neighbors, after the skeletal graphs of
// Snavely, Seitz and Szeliski (CVPR 2008). Votes cannot distinguish a road from
// one that is folded so that two equal facades meet: few pairs cross the break,
// many connect the facades. Strength can: neighbors share most of what they
// see, duplicates share only the duplicate structure.
//
// The support of a pair of frames is the number of triplet-consistent matches
// of all its image pairs. Its strength is the larger ratio of this support to
// the support of the best partner of either frame. The skeleton contains
//
//   pairs within a frame,
//   pairs with support whose frames are stronger than min_strength, and
//   pairs that connect components: of the pairs that leave a component, those
//   of at least min_connecting_strength times the strength of the strongest.
//
// Components that remain are connected in the same way with all matches as
// support, because a chain in which only neighbors are matched has no
// triplets.
//
// If the frames are a sequence, neighbors in time come first: the selection
// runs on pairs of frames at most a fifth of its reach apart, then on all
// neighbors, and other pairs only connect what is still apart. The few correct
// pairs across a weak cut of the sequence thus decide it, not the many pairs of
// a duplicate structure. Loops (pairs of distant frames) connect two components
// at one place only, that of the strongest loop: loops of several places can
// contradict each other.
//
// Per pair; false where pair_is_used is false.
[[nodiscard]] Mask SelectSkeletalGraph(const PairEvidence& evidence);

// The same for known numbers of matches and of triplet-consistent matches per
// pair.
Mask SelectSkeletalGraph(const FramePairIndex& index,
                         const std::vector<int>& num_matches,
                         const std::vector<int>& num_triplet_consistent,
                         const Mask& pair_is_used,
                         const PairFilteringOptions& options);

}  // namespace mgsfm

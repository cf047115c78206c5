// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <utility>
#include <vector>

#include "mgsfm/base/mask.h"
#include "pair_filtering/frame_pair_index.h"

namespace mgsfm {

// If images are missing, two stretches of frames may be connected by nothing
// but a few isolated pairs that contradict each other. Rotation averaging can
// satisfy any one of them; if it is wrong, the trajectory breaks there.
//
// A link is the set of all consistent pairs of two frames. It is an unsupported
// bridge if
//
//   its removal disconnects its frames (it is a bridge of the graph of links),
//   none of its matches is triplet-consistent,
//   some match of another link of one of its frames is, and
//   the inconsistent pairs between the two components have, together, at least
//   min_share_against_bridge times as many matches. In a sequence, only
//   neighbors count: the wrong loops across a cut grow with its length. Pairs
//   that an earlier rule rejects do not count: a vehicle contradicts every
//   right bridge.
//
// The third condition spares chains in which only neighbors were matched: they
// have no triplets, and one wrong pair would cut them all.
//
// The graph of a sequence contains no loops (links of distant frames).
// They connect two parts only if they have triplet-consistent matches and show
// more than one place. Structures that look alike can have hundreds of matches
// that agree with each other, but next to them, the parts show other things.
//
// Consistent pairs are those of pair_is_used; those of `pair_is_explained` are
// inconsistent for a known reason. Cost: linear in the pairs, times the depth
// of a tree for pairs of distant frames; if some links are bridges, in the
// matches; and the square of the number of loops that join two parts.
[[nodiscard]] Mask FindUnsupportedBridges(const PairEvidence& evidence,
                                          const Mask& pair_is_explained);

// Whether loops, the only links between two sets of frames, show one place of
// each, although both sets also show others. Loops show two places if two of
// them, at either end, have frames beyond the reach of the sequence that no
// consistent pair connects. `links` has the frames of the first set first.
[[nodiscard]] bool ShowOnePlace(const FramePairIndex& index,
                                const Mask& pair_is_used,
                                const std::vector<std::pair<int, int>>& links,
                                const std::vector<int>& frame_idxs1,
                                const std::vector<int>& frame_idxs2);

}  // namespace mgsfm

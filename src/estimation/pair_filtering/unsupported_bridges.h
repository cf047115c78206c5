// SPDX-License-Identifier: BSD-3-Clause
#pragma once

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
//   min_share_against_bridge times as many matches, or the link is a loop: its
//   frames are distant in a sequence.
//
// In a sequence, loop links without triplet-consistent matches connect nothing:
// bridges are those of the graph without them, and such loops between parts
// that nothing else connects are unsupported, however many there are.
//
// The third condition spares chains in which only neighbors were matched: they
// have no triplets, and one wrong pair would cut them all.
//
// Consistent pairs are those of pair_is_used. Cost: linear in the links;
// if some are bridges, in the matches; and the number of bridges without
// support times the number of inconsistent pairs.
[[nodiscard]] Mask FindUnsupportedBridges(const PairEvidence& evidence);

}  // namespace mgsfm

// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include "mgsfm/base/mask.h"
#include "pair_filtering/frame_pair_index.h"

namespace mgsfm {

// The loop pairs along a stretch that a rig passed twice.
//
// Loops decide nothing where few pairs of neighbours contradict them, because
// of duplicate structures. A structure, and so its duplicate, is visible in
// about as many frames as pairs of neighbours reach. Loop pairs that follow
// each other along a longer stretch of both passes repeat the scenery in the
// same order: the place is the same.
//
// Two frame pairs with used loop pairs are neighbours if their frames are at
// most kMaxLoopGap steps apart at both ends. A group of neighbours is a revisit
// if it extends over more than kMinRevisit steps of both passes. The frames of
// a loop must be as far from each other, or both are of one pass.
//
// Limits. If frames are so dense that one structure is visible in more of them
// than kMinRevisit, its duplicate looks like a revisit.

// Per pair. Without temporal order, none is. Cost: linear in the loop pairs
// times the number of loops near each.
[[nodiscard]] Mask FindRevisits(const FramePairIndex& index,
                                const Mask& pair_is_used);

}  // namespace mgsfm

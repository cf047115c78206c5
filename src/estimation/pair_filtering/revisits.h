// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include "mgsfm/base/mask.h"
#include "pair_filtering/frame_pair_index.h"

namespace mgsfm {

// The loop pairs along a stretch that a rig passed twice.
//
// Loops decide nothing where few pairs of neighbors contradict them, because
// of duplicate structures. A structure, and so its duplicate, is visible in
// about as many frames as pairs of neighbors reach. Loop pairs that follow
// each other along a longer stretch of both passes repeat the scenery in the
// same order: the place is the same.
//
// Two frame pairs with used loop pairs are neighbors if their frames are close
// at both ends, within a share of the reach of the sequence
// (frame_pair_index.h). A group of neighbors is a revisit if it extends over
// more than two reaches of both passes. The frames of a loop must be as far
// from each other, or both are of one pass.
//
// Limits. A structure that is visible along more than two reaches, such as a
// tower, has a duplicate that looks like a revisit.

// Per pair. Without temporal order, none is. Cost: linear in the loop pairs
// times the number of loops near each.
[[nodiscard]] Mask FindRevisits(const FramePairIndex& index,
                                const Mask& pair_is_used);

}  // namespace mgsfm

// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include "mgsfm/base/mask.h"
#include "pair_filtering/frame_pair_index.h"

namespace mgsfm {

// The loop pairs that would close a contested cut of a sequence.
//
// The pairs of neighbors that are used divide the frames into parts. The cut
// between two parts is contested if the motion of the rig contradicts pairs of
// neighbors across it (motion_continuity.h): the parts belong together, but
// their relative pose is unknown. Loop pairs alone do not decide it, because
// nothing there contradicts duplicate structures, unless they lie along a
// stretch that the rig passed twice (revisits.h). This holds for all parts that
// contested cuts separate from each other.
//
// Parts that follow each other in time without a pair across the cut, contested
// or not, belong together, too. Parts with a break between them
// (temporal_order.h), such as drives of different days, or without an order,
// may be joined by all loop pairs.
//
// A loop pair that contradicts the motion of the rig does not join parts: it
// tells where the rig is also where no pair crosses a cut.
//
// Per pair. No pair is marked without temporal order, or if nothing contradicts
// the motion. `loop_contradicts_motion` is empty if no loop pair does. Cost:
// that of FindRevisits().
[[nodiscard]] Mask FindLoopsAcrossContestedCuts(
    const FramePairIndex& index, const Mask& is_used,
    const Mask& pair_is_discontinuous, const Mask& loop_contradicts_motion);

}  // namespace mgsfm

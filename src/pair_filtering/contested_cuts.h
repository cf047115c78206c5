// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include "mgsfm/base/mask.h"
#include "pair_filtering/frame_pair_index.h"

namespace mgsfm {

// The loop pairs that would close a contested cut of a sequence.
//
// The pairs of neighbours that are used divide the frames into parts. The cut
// between two parts is contested if the motion of the rig contradicts pairs of
// neighbours across it (motion_continuity.h): the parts belong together, but
// their relative pose is unknown. Loop pairs alone do not decide it, because
// nothing there contradicts duplicate structures. This holds for all parts that
// contested cuts separate from each other. Parts that no rejected pair
// connects, such as drives of different days, may be joined, unless the motion
// of the rig contradicts the loop pair itself: it tells where the rig is also
// where no pair crosses a cut.
//
// `loop_contradicts_motion` is empty if no loop pair does. The result is empty
// without temporal order. Cost: linear in the pairs.
[[nodiscard]] Mask FindLoopsAcrossContestedCuts(
    const FramePairIndex& index, const Mask& is_used,
    const Mask& pair_is_discontinuous, const Mask& loop_contradicts_motion);

}  // namespace mgsfm

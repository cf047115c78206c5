// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include "mgsfm/base/mask.h"
#include "moving_objects/motion_continuity.h"
#include "pair_filtering/frame_pair_index.h"

namespace mgsfm {

// The loop pairs of a sequence that the path of the rig contradicts: their
// frames see the same place only if they are close to each other, but on the
// path they are further apart than
//
//   max_drift * (length of the path between them)
//       + (reach of the sequence) * (median step),
//
// the drift of positions and the reach of matches. Frames that are not
// comparable contradict nothing.
//
// Per pair. Cost: linear in the pairs.
[[nodiscard]] Mask FindLoopsAgainstPath(const FramePairIndex& index,
                                        const RigPath& path, double max_drift);

}  // namespace mgsfm

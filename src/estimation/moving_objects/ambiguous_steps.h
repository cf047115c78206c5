// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include "mgsfm/base/mask.h"
#include "moving_objects/motion_continuity.h"
#include "pair_filtering/frame_pair_index.h"

namespace mgsfm {

// Steps next to objects at which the motion of the rig is unknown
// (motion_continuity.h).
struct AmbiguousSteps {
  Mask pair_is_across;   // per pair of neighbors: its frames enclose a step
  Mask frame_is_beside;  // per frame: a step leads from or to it
};

// All false if more than a tenth of all steps are ambiguous: the motions are
// then in doubt as a whole. Cost: linear in the pairs and frames.
[[nodiscard]] AmbiguousSteps FindAmbiguousSteps(const FramePairIndex& index,
                                                const RigPath& path);

}  // namespace mgsfm

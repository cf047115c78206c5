// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include "mgsfm/base/mask.h"
#include "mgsfm/scene/estimates.h"
#include "mgsfm/scene/scene.h"
#include "mgsfm/scene/view_graph.h"
#include "pair_filtering/frame_pair_index.h"

namespace mgsfm {

// The steps of a sequence whose rotation the pairs of neighbors contradict
// (step_deviations.h).
//
// Duplicate structures that are some degrees off turn the whole trajectory at
// the step that the fewest pairs cross. Correct loop pairs seldom do that. They
// correct the drift, which is spread over all steps.
//
// The deviation of a pair is e_ij = Log(R_j^T R_ij R_i). A step is turned if
// the common deviation exceeds kMinTurn.

// Per frame: the step to it is turned. Without temporal order, none is.
[[nodiscard]] Mask FindTurnedSteps(const Scene& scene,
                                   const FramePairIndex& index,
                                   const ViewGraph& view_graph,
                                   const Mask& pair_is_used,
                                   const RotationEstimate& rotations);

}  // namespace mgsfm

// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include "mgsfm/base/mask.h"
#include "mgsfm/scene/estimates.h"
#include "mgsfm/scene/scene.h"
#include "mgsfm/scene/view_graph.h"
#include "pair_filtering/frame_pair_index.h"

namespace mgsfm {

// The steps of a sequence that loop pairs turn.
//
// Where few pairs of neighbours cross a step, many loop pairs outvote them:
// duplicate structures that are some degrees off turn the whole trajectory
// there, because a robust loss puts their error where it costs least. Correct
// loop pairs do not do that. They correct the drift, which is spread over all
// steps.
//
// A pair i, j of neighbours across the step has the deviation
//
//   e_ij = Log(R_j^T R_ij R_i),
//
// with i before j. All of them contain the turn of the step, in the frame of
// the world. With e the median of their coordinates and s that of |e_ij - e|,
// the step is turned if |e| > kMaxTurn and |e| > kMinAgreement s: most pairs
// of neighbours agree on another rotation.
//
// Per frame: the step to it is turned. The result is false without temporal
// order. Cost: linear in the pairs of neighbours times their time gap.
[[nodiscard]] Mask FindTurnedSteps(const Scene& scene,
                                   const FramePairIndex& index,
                                   const ViewGraph& view_graph,
                                   const Mask& pair_is_used,
                                   const RotationEstimate& rotations);

// The used loop pairs of one sequence with one of the steps between their
// frames. Per pair.
[[nodiscard]] Mask FindLoopsAcross(const FramePairIndex& index,
                                   const Mask& pair_is_used,
                                   const Mask& is_step_to_frame);

}  // namespace mgsfm

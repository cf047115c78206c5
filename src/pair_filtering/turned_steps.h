// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <Eigen/Core>
#include <optional>
#include <vector>

#include "mgsfm/base/mask.h"
#include "mgsfm/scene/estimates.h"
#include "mgsfm/scene/scene.h"
#include "mgsfm/scene/view_graph.h"
#include "pair_filtering/frame_pair_index.h"

namespace mgsfm {

// The steps of a sequence whose rotation most pairs of neighbours contradict in
// the same way.
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
// the world. With e the median of their coordinates, the step is turned by e if
// |e| > kMinTurn and |e_ij - e| < |e_ij| for nearly all pairs: none supports
// the step as it is.
//
// Per frame: the turn of the step to it, if it is turned.
using StepTurns = std::vector<std::optional<Eigen::Vector3d>>;

// Empty of turns without temporal order. Cost: linear in the pairs of
// neighbours times their time gap.
[[nodiscard]] StepTurns FindStepTurns(const Scene& scene,
                                      const FramePairIndex& index,
                                      const ViewGraph& view_graph,
                                      const Mask& pair_is_used,
                                      const RotationEstimate& rotations);

// The used loop pairs of one sequence with a turned step between their frames.
// Per pair.
[[nodiscard]] Mask FindLoopsAcross(const FramePairIndex& index,
                                   const Mask& pair_is_used,
                                   const StepTurns& turns);

}  // namespace mgsfm

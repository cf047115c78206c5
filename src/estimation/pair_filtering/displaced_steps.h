// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <Eigen/Core>
#include <optional>
#include <vector>

#include "mgsfm/base/mask.h"
#include "mgsfm/scene/estimates.h"
#include "pair_filtering/frame_pair_index.h"
#include "pair_filtering/skeleton_consistency.h"

namespace mgsfm {

// Steps of a sequence that nearly all pairs of neighbors contradict in the
// same way.
//
// Where few pairs of neighbors cross a step, many loop pairs outvote them: a
// robust loss puts the error of a loop where it costs least. Correct pairs of
// neighbors then agree that the step is wrong, and on what it should be.
//
// A used pair i, j of neighbors across the step, with i before j, has a
// deviation e_ij of its measurement from the estimate, in world axes. All of
// them contain the error of the step. Their median e, coordinate by coordinate,
// is common to the pairs if |e_ij - e| < |e_ij| for 90 % of them: hardly any
// supports the step as it is.
//
// Without temporal order, there are no such steps. Cost: linear in the pairs of
// neighbors times their time gap.

// Per frame: the common deviation of the pairs across the step to it.
using StepDeviations = std::vector<std::optional<Eigen::Vector3d>>;

// The steps whose translation the pairs contradict: rotations that drift leave
// a gap in each loop, and positions by held rotations close it best by a jump
// at the step that the fewest pairs cross.
//
// The deviation of a comparable pair is m - C, with C = c_2 - c_1 by the
// positions and m the measured baseline. With s the translation of the step by
// the positions, s' the median length of all steps and e the common deviation,
// the step is displaced if
//
//   |e| > max_relative_baseline_error * max(|s|, |s + e|, s').
//
// The median spares steps of a rig that brakes or stands, which are short.
// Steps from or to frames without a position are not examined.
[[nodiscard]] StepDeviations FindDisplacedSteps(
    const PairEvidence& evidence, const BaselineComparison& comparison,
    const std::vector<std::optional<Eigen::Vector3d>>& frame_center_in_world);

// Per frame: the pairs contradict the rotation of the step to it, as their
// common deviation Log(R_j^T R_ij R_i) exceeds kMinTurn. Duplicate structures
// that are some degrees off turn the whole trajectory at the step that the
// fewest pairs cross.
[[nodiscard]] Mask FindTurnedSteps(const PairEvidence& evidence,
                                   const RotationEstimate& rotations);

}  // namespace mgsfm

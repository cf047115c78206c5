// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <Eigen/Core>
#include <optional>
#include <vector>

#include "mgsfm/base/mask.h"
#include "mgsfm/pair_filtering/pair_filtering.h"
#include "mgsfm/scene/scene.h"
#include "mgsfm/scene/view_graph.h"
#include "pair_filtering/baseline_consistency.h"
#include "pair_filtering/frame_pair_index.h"
#include "pair_filtering/step_deviations.h"

namespace mgsfm {

// The steps of a sequence whose translation the pairs of neighbors contradict
// (step_deviations.h).
//
// Rotations that drift leave a gap in each loop. Positions by held rotations
// close it best by a jump at the step that the fewest pairs cross.
//
// The deviation of a comparable pair is e_ij = m - C, with C = c_2 - c_1 by the
// positions and m the measured baseline. With s the translation of the step by
// the positions, s' the median length of all steps and e the common deviation,
// the step is displaced if
//
//   |e| > max_relative_baseline_error * max(|s|, |s + e|, s').
//
// The median spares steps of a rig that brakes or stands, which are short.

// Per frame: the common deviation of the step to it, if that is displaced.
// Without temporal order, no step is displaced. Steps from or to frames without
// a position are not examined.
[[nodiscard]] StepDeviations FindDisplacedSteps(
    const Scene& scene, const FramePairIndex& index,
    const ViewGraph& view_graph, const Mask& pair_is_used,
    const BaselineComparison& comparison,
    const std::vector<std::optional<Eigen::Vector3d>>& frame_center_in_world,
    const PairFilteringOptions& options);

}  // namespace mgsfm

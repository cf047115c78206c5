// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <vector>

#include "pair_filtering/skeleton_consistency.h"
#include "translation_averaging/baseline_directions.h"
#include "translation_averaging/position_problem.h"
#include "translation_averaging/scale_averaging.h"

namespace mgsfm {

// The inputs of baseline consistency (pair_filtering/skeleton_consistency.h)
// from the values of translation averaging.

// Per direction: the baseline scale * group_factor * direction. Pairs in the
// largest scale group are comparable.
MeasuredBaselines MeasureBaselines(
    const std::vector<BaselineDirection>& directions, const PairScales& scales,
    const std::vector<double>& group_factor);

// Per image.
CameraCenters ComputeCameraCenters(const PositionProblem& problem,
                                   const Positions& positions);

// Baselines and centers in the unit of `group_factor`.
BaselineComparison CompareWith(const PositionProblem& problem,
                               const std::vector<BaselineDirection>& directions,
                               const PairScales& scales,
                               const std::vector<double>& group_factor,
                               const Positions& positions);

}  // namespace mgsfm

// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <vector>

#include "mgsfm/base/mask.h"
#include "translation/position_initialization.h"
#include "translation/position_problem.h"
#include "translation/baseline_directions.h"
#include "translation/scale_averaging.h"

namespace mgsfm {

// Pairs that no drift explains. Positions by the backbone alone
// (mgsfm/scene/backbone.h) drift with the way between two frames, measured
// along its strongest tree: a pair with measured baseline m = s b is impossible
// if for C = c_j - c_i
//
//   |C - m| > max_drift way + a quarter of a typical depth.
//
// Nothing is impossible if more than kMaxShareBeyondDrift of all pairs were.
// Per motion. Cost: a way through the tree for each pair.
Mask FindInconsistentBaselines(const PositionProblem& problem,
                               const std::vector<BaselineDirection>& motions,
                               const std::vector<int>& num_matches,
                               const Mask& is_in_skeleton,
                               const PairScales& scales,
                               const InitialPositions& by_skeleton,
                               double max_drift);

// Pairs of the backbone that positions found with other pairs tear: they
// contradict them (pair_consistency.h) where those of the backbone do not, or
// leave frames out that the backbone has.
int CountViolatedSkeletonEdges(const PositionProblem& problem,
                               const std::vector<BaselineDirection>& motions,
                               const Mask& is_in_skeleton,
                               const PairScales& scales,
                               const InitialPositions& by_skeleton,
                               const InitialPositions& initial);

}  // namespace mgsfm

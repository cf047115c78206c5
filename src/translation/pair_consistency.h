// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <vector>

#include "mgsfm/base/mask.h"
#include "translation/position_initialization.h"
#include "translation/position_problem.h"
#include "translation/baseline_directions.h"
#include "translation/scale_averaging.h"

namespace mgsfm {

// Pairs that see a repeated structure, such as two equal facades, agree among
// themselves on a motion that never was: the rotation may even be right, and
// on a straight road the direction too. What cannot be right is the length,
// which matches shared with true pairs tell (scale_averaging.h). Hence a pair
// with measured baseline m = s b contradicts the positions if for C = c_j - c_i
//
//   |C - m| > 1/2 max(|C|, |m|)   and   |C - m| > 1/4 of a typical depth.
//
// The second keeps pairs that close a loop: they miss by the drift, which is
// small compared with what the cameras see; copies miss by the distance from
// the original. Per motion; false where it has no direction or is not placed.
Mask FindInconsistentPairs(const PositionProblem& problem,
                           const std::vector<BaselineDirection>& motions,
                           const PairScales& scales,
                           const InitialPositions& initial,
                           const Positions& positions);

}  // namespace mgsfm

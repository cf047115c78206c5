// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <vector>

#include "view_graph/pair_estimation.h"

namespace mgsfm::internal {

// Two motions explain all matches of a plane. The few other matches do not tell
// which is right, since lenses and viewpoints displace keypoints by more than
// their noise. Rotations of three images tell: wrong ones do not close.
//
// Let p(a) be the probability of the motion a of a pair, and e(a, b, c) the
// angle by which the motions of three pairs do not close. With the prior p0,
//
//   log p(a) = log p0(a) + sum over triangles of
//              log sum over b, c of p(b) p(c) / (1 + e(a, b, c)^2 / s^2) +
//              const,
//
// where s is the robust standard deviation of the least closing errors of all
// triangles (mean field, 20 damped rounds). Swaps `pair` and `twin` of pairs
// whose twin is more probable. The result does not depend on the order of
// images. Cost: linear in the triangles with a pair that has a twin.
void ChooseTwins(std::vector<PairEstimate>* estimates);

}  // namespace mgsfm::internal

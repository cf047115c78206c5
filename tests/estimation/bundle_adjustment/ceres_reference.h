// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include "bundle_adjustment/problem_builder.h"

namespace mgsfm {

// Solves the same problem with Ceres, numeric derivatives and a different
// parametrization. Rotations must be completely free or constant, intrinsics
// constant. Returns the final cost.
double SolveWithCeres(const BundleProblem& problem, BundleState* state);

}  // namespace mgsfm

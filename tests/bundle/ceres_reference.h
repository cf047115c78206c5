// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include "bundle/bundle_problem.h"

namespace mgsfm {

// Solves the same problem with Ceres, numeric derivatives and another
// parametrisation. All rotations must be free or held as a whole, intrinsics
// held. Returns the final cost.
double SolveWithCeres(const BundleProblem& problem, BundleState* state);

}  // namespace mgsfm

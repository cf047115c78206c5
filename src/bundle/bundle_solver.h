// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include "bundle/bundle_problem.h"
#include "mgsfm/base/summary.h"

namespace mgsfm {

// Levenberg-Marquardt on the normal equations of normal_equations.h. lambda
// follows the ratio of actual to predicted decrease (Nielsen 1999, "Damping
// parameter in Marquardt's method"). Ends as kConverged when
//   |cost - new cost| <= function_tolerance cost   or
//   |step| <= parameter_tolerance (|state| + parameter_tolerance)    or
//   no step lowers the cost any more, as far as the arithmetic can tell.
//
// Every observation must be visible at the start. A point whose step would
// make one of its observations invisible moves by half of it, a quarter, or
// not at all; so that single points do not hold up all the others.
struct BundleSolverOptions {
  int max_num_iterations = 100;
  double function_tolerance = 1e-6;
  double parameter_tolerance = 1e-10;
};

// The cost of bundle_problem.h; infinite if an observation is not visible.
double BundleCost(const BundleProblem& problem, const BundleState& state,
                  int num_threads);

// On kFailure the state is as it was.
SolveSummary SolveBundle(const BundleProblem& problem,
                         const BundleSolverOptions& options, int num_threads,
                         BundleState* state);

}  // namespace mgsfm

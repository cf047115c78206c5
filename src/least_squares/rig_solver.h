// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <memory>

#include "least_squares/rig_problem.h"
#include "mgsfm/base/context.h"
#include "mgsfm/base/summary.h"
#include "mgsfm/least_squares/backend.h"

namespace mgsfm {

// How the native solver solves for what is left when points are eliminated.
enum class ReducedSolver {
  kAuto,       // kDirect unless the factor would be too large or too slow
  kDirect,     // sparse Cholesky factorisation
  kIterative,  // conjugate gradient; factorises a preconditioner alone
};

// Levenberg-Marquardt with points eliminated; docs/math/least_squares.md. With
// the damping lambda, which follows the ratio of actual to predicted decrease
// (Nielsen 1999, "Damping parameter in Marquardt's method", but falls ever
// faster as long as steps are as good as predicted, unless the start is far
// off), a step solves
// (J^T W J + lambda D) d = -J^T W r, D the diagonal of J^T W J and W = rho'
// (iteratively re-weighted least squares). Ends as kConverged when
//   |cost - new cost| <= function_tolerance cost                     or
//   |step| <= parameter_tolerance (|state| + parameter_tolerance)    or
//   no step lowers the cost any more, as far as the arithmetic can tell.
//
// Every observation must be visible at the start. A point whose step would
// make one of its observations invisible moves by half of it, a quarter, or
// not at all; so that single points do not hold up all the others.
//
// Results are the same to the last bit for every number of threads.
// Cost of an iteration: linear in the observations; for each point the square
// of the number of frames that see it; and the factorisation, or some tens of
// passes over the observations. Memory: about 100 bytes an observation, or 200
// if iterative, plus the factor.
struct RigSolverOptions {
  int max_num_iterations = 100;
  double function_tolerance = 1e-6;
  double parameter_tolerance = 1e-10;
  SolverBackend backend = SolverBackend::kNative;
  // Far from any solution, hardly damped steps keep folds that damped ones
  // would have undone: lambda falls by thirds only, and with scales, depths are
  // damped as if scales were not eliminated. Steps that do not gain enough are
  // shortened before they are refused, and scales at their bound are not held,
  // so that they may leave it.
  bool starts_far_off = false;
  ReducedSolver reduced_solver = ReducedSolver::kAuto;
};

// The cost of rig_problem.h; infinite if an observation is not visible.
template <class Observation>
double RigCost(const RigProblem<Observation>& problem, const RigState& state,
               int num_threads);

// Solves a problem as often as needed. What depends on its structure alone is
// made once; between solves the values of loss, baselines, linear terms and
// priors may change. On kFailure the state is as it was. Checks for an
// interruption once an iteration.
template <class Observation>
class RigSolver {
 public:
  // The problem must outlive this.
  RigSolver(const RigProblem<Observation>& problem,
            const RigSolverOptions& options, const Context& context);
  ~RigSolver();

  SolveSummary Solve(int max_num_iterations, RigState* state);

 private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

template <class Observation>
SolveSummary SolveRigProblem(const RigProblem<Observation>& problem,
                             const RigSolverOptions& options,
                             const Context& context, RigState* state) {
  return RigSolver<Observation>(problem, options, context)
      .Solve(options.max_num_iterations, state);
}

}  // namespace mgsfm

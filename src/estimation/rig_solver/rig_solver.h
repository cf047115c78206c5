// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <memory>

#include "mgsfm/base/context.h"
#include "mgsfm/base/solver.h"
#include "rig_solver/rig_problem.h"

namespace mgsfm {

// The solver of the reduced system (after elimination of the points).
enum class ReducedSolver {
  kAuto,       // kDirect unless its factor is too large or too slow
  kDirect,     // sparse Cholesky factorization
  kIterative,  // preconditioned conjugate gradients
};

// Levenberg-Marquardt with Schur complement; docs/maths/rig_solver.md.
//
// Step. (J^T W J + lambda D) d = -J^T W r with W = rho' (iteratively
// re-weighted least squares) and D the diagonal of J^T W J within [1e-6, 1e32].
//
// Damping. Let gamma be the ratio of actual to predicted decrease. A step is
// accepted if gamma > 1e-3. Then lambda is multiplied by 1 - (2 gamma - 1)^3
// but at least by mu, with mu = 1/3. Otherwise lambda is multiplied by 2, 4, 8,
// ... (Nielsen 1999, "Damping parameter in Marquardt's method"). Unlike in
// Nielsen's rule, mu is 1/3, 1/9, 1/27, ... for consecutive steps that are as
// good as predicted: the low-frequency deformations of long drives need a small
// lambda.
//
// Long steps of points. A point whose step exceeds a tenth of its distance from
// the closest camera takes the first of 1, 1/2, ..., 1/64 of its step that does
// not increase its own cost, or none. Other points do so only if an observation
// is invisible after the step. Single points therefore do not block the others.
// Every observation must be visible at the start.
//
// Points. With `minimizes_points`, each point is minimized by itself after each
// step, before the new cost is compared, with all other unknowns constant
// (embedded point iterations). Under a robust loss, or along the curved valley
// of focal lengths and depths, points converge slowly by joint steps. At poses
// far from the optimum, points fit these poses and reject the observations that
// contradict them. gamma includes the decrease by this minimization.
//
// Stopping criteria. kConverged if
//   |step| <= parameter_tolerance (|state| + parameter_tolerance)    or
//   an accepted step has cost - new cost <= function_tolerance cost, and the
//   next one, without damping (native backend), does so as well, predicts no
//   more (if it minimizes points), or fails  or
//   a step is rejected although it predicts a decrease of at most 1e-14 cost,
//   which is below rounding errors.
// kFailure if the initial cost or a derivative is not finite, or lambda exceeds
// 1e16.
//
// Results are the same to the last bit for every number of threads. Cost of an
// iteration: linear in the observations, for each point quadratic in the number
// of frames that observe it, and the factorization, or some tens of passes over
// the observations. Memory: about 13 bytes per observation and 60 per point,
// and 50 more for each if kIterative; plus the matrix and its factor.
struct RigSolverOptions {
  int max_num_iterations = 100;
  double function_tolerance = 1e-6;
  double parameter_tolerance = 1e-10;
  SolverBackend backend = SolverBackend::kNative;
  ReducedSolver reduced_solver = ReducedSolver::kAuto;
  bool minimizes_points = false;  // native backend
};

// Solves a problem repeatedly. The structure is analyzed once; between solves,
// the values of the loss, baselines, linear terms and priors may change. On
// kFailure, the state does not change. Checks for interruption in each
// iteration.
template <class Observation>
class RigSolver {
 public:
  // The problem must outlive the solver. The native backend copies observations
  // and point_begin, so that the caller may free them afterward.
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

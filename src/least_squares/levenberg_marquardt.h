// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include "least_squares/rig_solver.h"
#include "mgsfm/base/context.h"
#include "mgsfm/base/summary.h"

namespace mgsfm {

// A trial step from the present state.
struct TrialStep {
  double new_cost = 0.0;
  // Of the cost, by the linear model, for the whole step.
  double predicted_decrease = 0.0;
  double step_norm = 0.0;
  double state_norm = 0.0;
};

// What the trust-region loop knows of a problem: a state, and steps from it.
class DampedProblem {
 public:
  virtual ~DampedProblem() = default;
  // Infinite or not a number if the state is not in the domain.
  virtual double Cost() = 0;
  // Forms the equations of a step, damped by lambda. False if a derivative is
  // not finite.
  virtual bool Linearize(double lambda) = 0;
  // False if the equations are not positive definite to working precision.
  virtual bool Solve() = 0;
  // Goes a part of the step, length <= 1.
  virtual TrialStep TryStep(double length) = 0;
  virtual void AcceptStep() = 0;
};

// The one trust-region loop; rules in mgsfm/least_squares/rig_solver.h.
SolveSummary MinimizeByLevenbergMarquardt(const RigSolverOptions& options,
                                          int max_num_iterations,
                                          const Context& context,
                                          DampedProblem* problem);

}  // namespace mgsfm

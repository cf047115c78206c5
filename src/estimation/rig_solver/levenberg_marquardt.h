// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include "mgsfm/base/context.h"
#include "mgsfm/base/solver.h"
#include "rig_solver/rig_solver.h"

namespace mgsfm {

// The result of a trial step from the current state.
struct TrialStep {
  double new_cost = 0.0;
  // Decrease of the cost predicted by the linear model.
  double predicted_decrease = 0.0;
  double step_norm = 0.0;
  double state_norm = 0.0;
};

// The interface of a problem to the trust-region loop: a state and its steps.
class DampedProblem {
 public:
  virtual ~DampedProblem() = default;
  // Not finite if the state is outside the domain.
  virtual double Cost() = 0;
  // Forms the normal equations with damping lambda. False if a derivative is
  // not finite.
  virtual bool Linearize(double lambda) = 0;
  // False if the equations are not positive definite to working precision.
  virtual bool Solve() = 0;
  // Evaluates the state after the step.
  virtual TrialStep TryStep() = 0;
  // Minimizes over the points of the state after the step, with all other
  // unknowns constant, until further steps of points predict a decrease of at
  // most `tolerance` in total. `cost` is that of this state; returns the new
  // one. By default, there are no points.
  virtual double MinimizeTrialPoints(double cost, double /*tolerance*/) {
    return cost;
  }
  virtual void AcceptStep() = 0;
};

// The trust-region loop of all rig problems; see rig_solver.h for its rules.
SolveSummary MinimizeByLevenbergMarquardt(const RigSolverOptions& options,
                                          int max_num_iterations,
                                          const Context& context,
                                          DampedProblem* problem);

}  // namespace mgsfm

// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <Eigen/Cholesky>
#include <Eigen/Core>
#include <cmath>

#include "geometry/so3.h"
#include "mgsfm/base/solver.h"
#include "mgsfm/geometry/rigid3.h"

namespace mgsfm {

// Normal equations over the update R <- Exp(delta[0:3]) R, t <- t + delta[3:6].
struct PoseEquations {
  PoseMatrix hessian = PoseMatrix::Zero();
  PoseVector gradient = PoseVector::Zero();
  double cost = 0.0;
};

// sum of log(x_i) for x_i >= 1, with few logarithms: one is as expensive as the
// other terms of an error.
class LogSum {
 public:
  void Add(double x) {
    product_ *= x;
    if (product_ <= 1e100) return;
    sum_ += std::log(product_);
    product_ = 1.0;
  }
  double Total() const { return sum_ + std::log(product_); }

 private:
  double product_ = 1.0;
  double sum_ = 0.0;
};

struct PoseStepOptions {
  int max_num_iterations = 10;
  double relative_cost_tolerance = 1e-6;
  double ridge = 1e-9;  // times the largest diagonal element, added to all
};

// Levenberg-Marquardt for a single pose. Damping starts at 1e-4, decreases
// tenfold after a step that does not increase the cost and increases tenfold
// otherwise. Stops when the relative decrease of the cost is at most
// relative_cost_tolerance. Linearize(pose) returns PoseEquations.
template <class Linearize>
SolveSummary MinimizeOverPose(const PoseStepOptions& options,
                              const Linearize& linearize, Rigid3* pose) {
  SolveSummary summary;
  PoseEquations equations = linearize(*pose);
  summary.initial_cost = equations.cost;
  summary.termination = Termination::kMaxIterations;
  double damping = 1e-4;
  while (summary.num_iterations < options.max_num_iterations) {
    ++summary.num_iterations;
    PoseMatrix damped = equations.hessian;
    damped.diagonal() *= 1.0 + damping;
    damped.diagonal().array() +=
        options.ridge * damped.diagonal().maxCoeff() + 1e-300;
    const PoseVector step = -damped.ldlt().solve(equations.gradient);
    const Rigid3 candidate = Updated(*pose, step);
    const PoseEquations next = linearize(candidate);
    const double decrease = equations.cost - next.cost;
    if (!(decrease >= 0.0)) {
      damping *= 10.0;
      continue;
    }
    const bool is_converged =
        decrease <= options.relative_cost_tolerance * equations.cost;
    *pose = candidate;
    equations = next;
    damping *= 0.1;
    if (is_converged) {
      summary.termination = Termination::kConverged;
      break;
    }
  }
  summary.final_cost = equations.cost;
  return summary;
}

}  // namespace mgsfm

// SPDX-License-Identifier: BSD-3-Clause
#include "least_squares/levenberg_marquardt.h"

#include <algorithm>
#include <cmath>

namespace mgsfm {
namespace {

constexpr double kMinRatio = 1e-3;
constexpr double kRoundOff = 1e-14;
constexpr double kFirstLambda = 1e-4;
constexpr double kMinLambda = 1e-16;
constexpr double kMaxLambda = 1e16;
// Of lambda, after a step as good as predicted; from one such step to the next
// it is applied once more.
constexpr double kShrinkage = 1.0 / 3.0;
// A step far from a solution is shortened to between these shares of its length
// until it gains this share of what that length promises, or so many times.
constexpr double kMinShortening = 0.1;
constexpr double kMaxShortening = 0.6;
constexpr double kMinGain = 1e-4;
constexpr int kMaxNumShortenings = 6;
// Of what is promised; the slope at the start is one to two times that.
constexpr double kSlope = 1.5;

class LevenbergMarquardt {
 public:
  LevenbergMarquardt(const RigSolverOptions& options, int max_num_iterations,
                     const Context& context, DampedProblem* problem)
      : options_(options),
        max_num_iterations_(max_num_iterations),
        context_(context),
        problem_(*problem) {}

  SolveSummary Run() {
    Start();
    while (!is_done_ && summary_.num_iterations < max_num_iterations_) {
      context_.CheckInterrupted();
      ++summary_.num_iterations;
      if (!problem_.Linearize(lambda_)) {
        Finish(Termination::kFailure, "A derivative is not finite.");
      } else if (!problem_.Solve()) {
        Reject();
      } else {
        Judge(FindStep());
      }
    }
    summary_.final_cost = cost_;
    return summary_;
  }

 private:
  void Start() {
    cost_ = problem_.Cost();
    summary_.initial_cost = cost_;
    summary_.termination = Termination::kMaxIterations;
    summary_.message = "Reached the largest number of iterations.";
    if (!std::isfinite(cost_)) {
      Finish(Termination::kFailure, "The start has no finite cost.");
    } else if (cost_ == 0.0) {
      Finish(Termination::kConverged, "The start is optimal.");
    }
  }

  // Backtracks along the step (Armijo) if the start is far off.
  TrialStep FindStep() {
    TrialStep step = problem_.TryStep(1.0);
    if (!options_.starts_far_off) return step;
    const double whole_norm = step.step_norm;
    double length = 1.0;
    for (int i = 0; i < kMaxNumShortenings; ++i) {
      const double promise = length * step.predicted_decrease;
      const double rise = step.new_cost - cost_;
      if (rise <= -kMinGain * promise) break;
      // The lowest point of the parabola through both costs.
      const double lowest = 0.5 * kSlope * promise / (rise + kSlope * promise);
      length *= std::isfinite(rise)
                    ? std::clamp(lowest, kMinShortening, kMaxShortening)
                    : kMinShortening;
      step = problem_.TryStep(length);
    }
    // That a step was shortened much is no sign of convergence.
    step.step_norm = whole_norm;
    return step;
  }

  void Judge(const TrialStep& step) {
    const double decrease = cost_ - step.new_cost;
    const double tolerance = options_.parameter_tolerance;
    if (step.step_norm <= tolerance * (step.state_norm + tolerance)) {
      Finish(Termination::kConverged, "The step is small.");
    } else if (decrease > kMinRatio * step.predicted_decrease &&
               decrease > 0.0) {
      Accept(step.new_cost, decrease / step.predicted_decrease);
    } else if (step.predicted_decrease <= kRoundOff * cost_) {
      Finish(Termination::kConverged, "No step lowers the cost.");
    } else {
      Reject();
    }
  }

  void Accept(double new_cost, double ratio) {
    const bool is_converged =
        cost_ - new_cost <= options_.function_tolerance * cost_;
    problem_.AcceptStep();
    cost_ = new_cost;
    Shrink(1.0 - std::pow(2.0 * ratio - 1.0, 3));
    if (is_converged || cost_ == 0.0) {
      Finish(Termination::kConverged, "The cost hardly changes.");
    }
  }

  // The bends of a long drive have curvatures far below those of its joints:
  // they move only once lambda is as small, which shrinking by the same factor
  // each time takes more steps for the longer the drive is.
  void Shrink(double factor) {
    if (factor < kShrinkage) {
      lambda_ *= lambda_shrinkage_;
      if (!options_.starts_far_off) lambda_shrinkage_ *= kShrinkage;
    } else {
      lambda_ *= factor;
      lambda_shrinkage_ = kShrinkage;
    }
    lambda_ = std::max(kMinLambda, lambda_);
    lambda_growth_ = 2.0;
  }

  void Reject() {
    lambda_ *= lambda_growth_;
    lambda_growth_ *= 2.0;
    lambda_shrinkage_ = kShrinkage;
    if (lambda_ > kMaxLambda) {
      Finish(Termination::kFailure, "No damping gives a step.");
    }
  }

  void Finish(Termination termination, const char* message) {
    summary_.termination = termination;
    summary_.message = message;
    is_done_ = true;
  }

  const RigSolverOptions& options_;
  const int max_num_iterations_;
  const Context& context_;
  DampedProblem& problem_;
  double cost_ = 0.0;
  double lambda_ = kFirstLambda;
  double lambda_growth_ = 2.0;
  double lambda_shrinkage_ = kShrinkage;
  bool is_done_ = false;
  SolveSummary summary_;
};

}  // namespace

SolveSummary MinimizeByLevenbergMarquardt(const RigSolverOptions& options,
                                          int max_num_iterations,
                                          const Context& context,
                                          DampedProblem* problem) {
  return LevenbergMarquardt(options, max_num_iterations, context, problem)
      .Run();
}

}  // namespace mgsfm

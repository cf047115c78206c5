// SPDX-License-Identifier: BSD-3-Clause
#include "rig_solver/levenberg_marquardt.h"

#include <algorithm>
#include <cmath>

namespace mgsfm {
namespace {

// Factor of lambda after a step that is as good as predicted (Nielsen), and the
// ratio of these factors for consecutive such steps.
constexpr double kShrinkage = 1.0 / 3.0;

// Below this value, damping vanishes in the rounding of the diagonal.
constexpr double kMinLambda = 1e-16;

// The tolerance of points in tolerances of the cost. Points move slowly where
// the loss is flat: the decrease that follows there is a hundred times what a
// step predicts (docs/results/constants.md).
constexpr double kPointTolerance = 1e-3;

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
      ReportProgress();
      ++summary_.num_iterations;
      if (!problem_.Linearize(lambda_)) {
        FailLinearization();
      } else if (!problem_.Solve()) {
        Reject();
      } else {
        AcceptOrReject(TryStep());
      }
    }
    if (!is_done_ && is_converged_) FinishAtSmallChange();
    summary_.final_cost = cost_;
    const auto num_done = static_cast<size_t>(summary_.num_iterations);
    context_.ReportProgress("solver", num_done, num_done);
    return summary_;
  }

 private:
  void Start() {
    cost_ = problem_.Cost();
    summary_.initial_cost = cost_;
    summary_.termination = Termination::kMaxIterations;
    summary_.message = "Reached the maximum number of iterations.";
    if (!std::isfinite(cost_)) {
      Finish(Termination::kFailure, "The initial cost is not finite.");
    } else if (cost_ == 0.0) {
      Finish(Termination::kConverged, "The initial cost is zero.");
    }
  }

  // Estimates the iterations until convergence from the relative decrease of
  // the cost, which is about geometric. `max_num_iterations` is far too
  // pessimistic.
  void ReportProgress() const {
    const double num_done = summary_.num_iterations;
    const double num_estimated =
        share_ > 0.0 ? std::min<double>(max_num_iterations_, num_done / share_)
                     : max_num_iterations_;
    context_.ReportProgress(
        "solver", static_cast<size_t>(summary_.num_iterations),
        static_cast<size_t>(std::max(num_done + 1.0, num_estimated)));
  }

  TrialStep TryStep() {
    TrialStep step = problem_.TryStep();
    if (options_.minimizes_points && std::isfinite(step.new_cost)) {
      step.new_cost = problem_.MinimizeTrialPoints(
          step.new_cost,
          kPointTolerance * options_.function_tolerance * step.new_cost);
    }
    return step;
  }

  void AcceptOrReject(const TrialStep& step) {
    const double decrease = cost_ - step.new_cost;
    const double tolerance = options_.parameter_tolerance;
    // Like Ceres, accepts a step if the cost decreases by at least a thousandth
    // of what the model predicts. The relative rounding error of a cost is some
    // tens of machine precisions.
    if (step.step_norm <= tolerance * (step.state_norm + tolerance)) {
      Finish(Termination::kConverged, "The step is small.");
    } else if (decrease > 1e-3 * step.predicted_decrease && decrease > 0.0) {
      // Rounding errors of small steps can predict an increase.
      Accept(step);
    } else if (step.predicted_decrease <= 1e-14 * cost_) {
      Finish(Termination::kConverged, "No step decreases the cost.");
    } else {
      Reject();
    }
  }

  void Accept(const TrialStep& step) {
    const double old_cost = cost_;
    const bool is_undamped = lambda_ == kMinLambda;
    problem_.AcceptStep();
    cost_ = step.new_cost;
    const double relative_decrease = (old_cost - cost_) / old_cost;
    const double ratio = step.predicted_decrease > 0.0
                             ? (old_cost - cost_) / step.predicted_decrease
                             : 1.0;
    const double share =
        std::log(relative_decrease) / std::log(options_.function_tolerance);
    share_ = is_converged_ ? share : std::max(share_, share);
    Shrink(1.0 - std::pow(2.0 * ratio - 1.0, 3));
    // Without damping, points at infinity wander from one minimum of the loss
    // to the next if they are minimized, which no step predicts.
    is_converged_ =
        relative_decrease <= options_.function_tolerance ||
        (is_undamped && options_.minimizes_points &&
         step.predicted_decrease <= options_.function_tolerance * old_cost);
    if (cost_ == 0.0 || (is_converged_ && is_undamped)) {
      FinishAtSmallChange();
    } else if (is_converged_) {
      damped_lambda_ = lambda_;
      lambda_ = kMinLambda;
    }
  }

  // The low-frequency deformations of a long drive have tiny curvatures. They
  // converge only when lambda is equally small, which takes many steps if
  // lambda shrinks by a constant factor.
  void Shrink(double factor) {
    if (factor < kShrinkage) {
      lambda_ *= lambda_shrinkage_;
      lambda_shrinkage_ *= kShrinkage;
    } else {
      lambda_ *= factor;
      lambda_shrinkage_ = kShrinkage;
    }
    lambda_ = std::max(kMinLambda, lambda_);
    lambda_growth_ = 2.0;
  }

  void Reject() {
    if (is_converged_) return FinishAtSmallChange();
    lambda_ = std::max(lambda_ * lambda_growth_, damped_lambda_);
    damped_lambda_ = 0.0;
    lambda_growth_ *= 2.0;
    lambda_shrinkage_ = kShrinkage;
    // Above this value, a step vanishes in the rounding of the state.
    if (lambda_ > 1e16) {
      Finish(Termination::kFailure, "The damping exceeds its maximum.");
    }
  }

  void FailLinearization() {
    if (is_converged_) return FinishAtSmallChange();
    Finish(Termination::kFailure, "A derivative is not finite.");
  }

  void FinishAtSmallChange() {
    Finish(Termination::kConverged,
           "The relative change of the cost is small.");
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
  double share_ = 0.0;    // of the iterations that are done, estimated
  double lambda_ = 1e-4;  // as in Ceres
  double lambda_growth_ = 2.0;
  double lambda_shrinkage_ = kShrinkage;
  double damped_lambda_ = 0.0;  // before a step without damping
  bool is_converged_ = false;   // but for what damping holds back
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

// SPDX-License-Identifier: BSD-3-Clause
#include "least_squares/levenberg_marquardt.h"

#include <gtest/gtest.h>

#include <Eigen/Cholesky>
#include <Eigen/Core>
#include <cmath>
#include <limits>

#include "least_squares/rig_fixtures.h"

namespace mgsfm {
namespace {

// Rosenbrock's valley: residuals (1 - x, 10 (y - x^2)), optimum (1, 1).
class Rosenbrock : public DampedProblem {
 public:
  explicit Rosenbrock(const Eigen::Vector2d& start) : x_(start) {}

  double Cost() override { return 0.5 * Residual(x_).squaredNorm(); }
  bool Linearize(double lambda) override {
    lambda_ = lambda;
    Eigen::Matrix2d J;
    J << -1.0, 0.0, -20.0 * x_[0], 10.0;
    hessian_ = J.transpose() * J;
    gradient_ = J.transpose() * Residual(x_);
    return derivative_is_finite_;
  }
  bool Solve() override {
    ++num_solves_;
    if (!is_solvable_) return false;
    Eigen::Matrix2d damped = hessian_;
    damped.diagonal() *= 1.0 + lambda_;
    step_ = damped.ldlt().solve(-gradient_);
    return true;
  }
  TrialStep TryStep() override {
    TrialStep step;
    step.new_cost = 0.5 * Residual(x_ + step_).squaredNorm();
    step.predicted_decrease =
        -gradient_.dot(step_) - 0.5 * step_.dot(hessian_ * step_);
    step.step_norm = step_.norm();
    step.state_norm = x_.norm();
    return step;
  }
  void AcceptStep() override { x_ += step_; }

  const Eigen::Vector2d& x() const { return x_; }
  int num_solves() const { return num_solves_; }
  void MakeUnsolvable() { is_solvable_ = false; }
  void MakeDerivativeInfinite() { derivative_is_finite_ = false; }

 private:
  static Eigen::Vector2d Residual(const Eigen::Vector2d& x) {
    return {1.0 - x[0], 10.0 * (x[1] - x[0] * x[0])};
  }

  Eigen::Vector2d x_, gradient_, step_;
  Eigen::Matrix2d hessian_;
  double lambda_ = 0.0;
  int num_solves_ = 0;
  bool is_solvable_ = true;
  bool derivative_is_finite_ = true;
};

SolveSummary Minimize(int max_num_iterations, Rosenbrock* problem) {
  RigSolverOptions options;
  options.function_tolerance = 0.0;
  return MinimizeByLevenbergMarquardt(options, max_num_iterations, Threads(1),
                                      problem);
}

TEST(LevenbergMarquardtTest, FollowsACurvedValley) {
  Rosenbrock problem({-1.2, 1.0});
  const SolveSummary summary = Minimize(200, &problem);
  EXPECT_EQ(summary.termination, Termination::kConverged);
  EXPECT_LT((problem.x() - Eigen::Vector2d(1.0, 1.0)).norm(), 1e-8);
  EXPECT_GT(summary.initial_cost, 1.0);
  EXPECT_EQ(summary.final_cost, problem.Cost());
}

TEST(LevenbergMarquardtTest, CostNeverRises) {
  double last = std::numeric_limits<double>::infinity();
  for (int n = 0; n < 30; ++n) {
    Rosenbrock problem({-1.2, 1.0});
    const SolveSummary summary = Minimize(n, &problem);
    EXPECT_LE(summary.final_cost, last);
    last = summary.final_cost;
  }
}

TEST(LevenbergMarquardtTest, StopsAfterTheMostIterations) {
  Rosenbrock problem({-1.2, 1.0});
  const SolveSummary summary = Minimize(3, &problem);
  EXPECT_EQ(summary.termination, Termination::kMaxIterations);
  EXPECT_EQ(summary.num_iterations, 3);
  EXPECT_EQ(problem.num_solves(), 3);
}

TEST(LevenbergMarquardtTest, OptimalStartIsDone) {
  Rosenbrock problem({1.0, 1.0});
  EXPECT_EQ(Minimize(10, &problem).termination, Termination::kConverged);
  EXPECT_EQ(problem.num_solves(), 0);
}

TEST(LevenbergMarquardtTest, FailsIfNoDampingHelps) {
  Rosenbrock problem({-1.2, 1.0});
  problem.MakeUnsolvable();
  EXPECT_EQ(Minimize(100, &problem).termination, Termination::kFailure);
  EXPECT_EQ(problem.x(), Eigen::Vector2d(-1.2, 1.0));
}

TEST(LevenbergMarquardtTest, FailsIfNotFinite) {
  Rosenbrock start({std::nan(""), 1.0});
  EXPECT_EQ(Minimize(10, &start).termination, Termination::kFailure);
  Rosenbrock derivative({-1.2, 1.0});
  derivative.MakeDerivativeInfinite();
  EXPECT_EQ(Minimize(10, &derivative).termination, Termination::kFailure);
}

}  // namespace
}  // namespace mgsfm

// SPDX-License-Identifier: BSD-3-Clause
#include "rig_solver/levenberg_marquardt.h"

#include <gtest/gtest.h>

#include <Eigen/Cholesky>
#include <Eigen/Core>
#include <algorithm>
#include <cmath>
#include <limits>
#include <vector>

#include "estimation/rig_solver/rig_fixtures.h"

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
    step.new_cost = TrialCost();
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

 protected:
  double TrialCost() const { return 0.5 * Residual(x_ + step_).squaredNorm(); }
  // The trial step ends in the valley, above its first coordinate.
  void MoveToValley() { step_[1] = std::pow(x_[0] + step_[0], 2) - x_[1]; }

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

// The same valley, of which y is a point.
class RosenbrockWithPoint : public Rosenbrock {
 public:
  using Rosenbrock::Rosenbrock;
  double MinimizeTrialPoints(double cost, double tolerance) override {
    EXPECT_EQ(cost, TrialCost());
    EXPECT_GE(tolerance, 0.0);
    EXPECT_LE(tolerance, 1e-3 * cost);
    MoveToValley();
    ++num_minimized_;
    return TrialCost();
  }
  int num_minimized() const { return num_minimized_; }

 private:
  int num_minimized_ = 0;
};

TEST(LevenbergMarquardtTest, MinimizesPointsOfTrialStepsIfAsked) {
  RigSolverOptions options;
  int num_iterations[2];
  for (const bool minimizes_points : {false, true}) {
    options.minimizes_points = minimizes_points;
    RosenbrockWithPoint problem({-1.2, 1.0});
    const SolveSummary summary =
        MinimizeByLevenbergMarquardt(options, 200, Threads(1), &problem);
    EXPECT_EQ(summary.termination, Termination::kConverged);
    EXPECT_EQ(summary.final_cost, problem.Cost());
    EXPECT_LT((problem.x() - Eigen::Vector2d(1.0, 1.0)).norm(), 1e-4);
    EXPECT_EQ(problem.num_minimized(),
              minimizes_points ? summary.num_iterations : 0);
    num_iterations[minimizes_points ? 1 : 0] = summary.num_iterations;
  }
  // The valley is straight in the first coordinate.
  EXPECT_LT(2 * num_iterations[1], num_iterations[0]);
}

TEST(LevenbergMarquardtTest, FollowsACurvedValley) {
  Rosenbrock problem({-1.2, 1.0});
  const SolveSummary summary = Minimize(200, &problem);
  EXPECT_EQ(summary.termination, Termination::kConverged);
  EXPECT_LT((problem.x() - Eigen::Vector2d(1.0, 1.0)).norm(), 1e-8);
  EXPECT_GT(summary.initial_cost, 1.0);
  EXPECT_EQ(summary.final_cost, problem.Cost());
}

TEST(LevenbergMarquardtTest, CostNeverIncreases) {
  double last = std::numeric_limits<double>::infinity();
  for (int n = 0; n < 30; ++n) {
    Rosenbrock problem({-1.2, 1.0});
    const SolveSummary summary = Minimize(n, &problem);
    EXPECT_LE(summary.final_cost, last);
    last = summary.final_cost;
  }
}

TEST(LevenbergMarquardtTest, StopsAfterTheMaximumNumberOfIterations) {
  Rosenbrock problem({-1.2, 1.0});
  const SolveSummary summary = Minimize(3, &problem);
  EXPECT_EQ(summary.termination, Termination::kMaxIterations);
  EXPECT_EQ(summary.num_iterations, 3);
  EXPECT_EQ(problem.num_solves(), 3);
}

TEST(LevenbergMarquardtTest, OptimalInitialStateConverges) {
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

// A chain of springs with one fixed end, initially stretched uniformly. All
// springs shrink, so the last node moves by the sum of all changes.
class Chain : public DampedProblem {
 public:
  explicit Chain(int size) : x_(Eigen::VectorXd::LinSpaced(size, 1.0, size)) {}

  double Cost() override { return Cost(x_); }
  bool Linearize(double lambda) override {
    lambdas_.push_back(lambda);
    return true;
  }
  // The matrix is tridiagonal.
  bool Solve() override {
    const int size = static_cast<int>(x_.size());
    Eigen::VectorXd diagonal = Diagonal();
    diagonal *= 1.0 + lambdas_.back();
    step_ = -Gradient(x_);
    for (int i = 1; i < size; ++i) {
      diagonal[i] -= 1.0 / diagonal[i - 1];
      step_[i] += step_[i - 1] / diagonal[i - 1];
    }
    step_[size - 1] /= diagonal[size - 1];
    for (int i = size - 2; i >= 0; --i) {
      step_[i] = (step_[i] + step_[i + 1]) / diagonal[i];
    }
    return true;
  }
  TrialStep TryStep() override {
    TrialStep step;
    step.new_cost = Cost(x_ + step_);
    step.predicted_decrease = Cost(x_) - Cost(x_ + step_);  // linear residuals
    step.step_norm = step_.norm();
    step.state_norm = x_.norm();
    return step;
  }
  void AcceptStep() override { x_ += step_; }

  const std::vector<double>& lambdas() const { return lambdas_; }
  bool IsUndamped() const { return lambdas_.back() <= 1e-16; }

 protected:
  Eigen::VectorXd x_, step_;

 private:
  static constexpr double kLength = 0.9;

  static double Cost(const Eigen::VectorXd& x) {
    double cost = 0.0, last = 0.0;
    for (const double position : x) {
      cost += 0.5 * std::pow(position - last - kLength, 2);
      last = position;
    }
    return cost;
  }
  static Eigen::VectorXd Gradient(const Eigen::VectorXd& x) {
    Eigen::VectorXd gradient = Eigen::VectorXd::Zero(x.size());
    for (Eigen::Index i = 0; i < x.size(); ++i) {
      const double excess = x[i] - (i > 0 ? x[i - 1] : 0.0) - kLength;
      gradient[i] += excess;
      if (i > 0) gradient[i - 1] -= excess;
    }
    return gradient;
  }
  Eigen::VectorXd Diagonal() const {
    Eigen::VectorXd diagonal = Eigen::VectorXd::Constant(x_.size(), 2.0);
    diagonal[x_.size() - 1] = 1.0;
    return diagonal;
  }

  std::vector<double> lambdas_;
};

SolveSummary MinimizeChain(double function_tolerance, int max_num_iterations,
                           Chain* chain, bool minimizes_points = false) {
  RigSolverOptions options;
  options.minimizes_points = minimizes_points;
  options.function_tolerance = function_tolerance;
  return MinimizeByLevenbergMarquardt(options, max_num_iterations, Threads(1),
                                      chain);
}

// Damping holds back the ends of the chain: a damped step decreases the cost by
// much less than is left.
TEST(LevenbergMarquardtTest, SmallChangesOfDampedStepsAreNotConvergence) {
  Chain chain(10000);
  const SolveSummary summary = MinimizeChain(0.5, 100, &chain);
  EXPECT_EQ(summary.termination, Termination::kConverged);
  EXPECT_LT(summary.final_cost, 1e-9 * summary.initial_cost);
  EXPECT_GT(chain.lambdas()[0], 1e-16);
  EXPECT_EQ(chain.lambdas()[1], 1e-16);
  Chain other(10000);
  EXPECT_EQ(MinimizeChain(0.5, 1, &other).termination, Termination::kConverged);
}

// A chain that no undamped step improves.
class FragileChain : public Chain {
 public:
  using Chain::Chain;
  TrialStep TryStep() override {
    TrialStep step = Chain::TryStep();
    if (IsUndamped()) step.new_cost = 2.0 * Cost();
    return step;
  }
};

TEST(LevenbergMarquardtTest, ConvergesIfUndampedStepsFail) {
  FragileChain chain(10000);
  const SolveSummary summary = MinimizeChain(0.5, 100, &chain);
  EXPECT_EQ(summary.termination, Termination::kConverged);
  EXPECT_LT(summary.final_cost, summary.initial_cost);
  EXPECT_EQ(chain.lambdas().back(), 1e-16);
  EXPECT_EQ(summary.num_iterations, static_cast<int>(chain.lambdas().size()));
}

// A chain whose derivatives are infinite without damping.
class BrittleChain : public Chain {
 public:
  using Chain::Chain;
  bool Linearize(double lambda) override {
    return Chain::Linearize(lambda) && !IsUndamped();
  }
};

TEST(LevenbergMarquardtTest, ConvergesIfUndampedDerivativesFail) {
  BrittleChain chain(10000);
  const SolveSummary summary = MinimizeChain(0.5, 100, &chain);
  EXPECT_EQ(summary.termination, Termination::kConverged);
  EXPECT_EQ(summary.num_iterations, 2);
  EXPECT_LT(summary.final_cost, summary.initial_cost);
}

// A chain whose first undamped step is half as long as it should be. No other
// undamped step improves it.
class StiffChain : public FragileChain {
 public:
  using FragileChain::FragileChain;
  TrialStep TryStep() override {
    if (num_undamped_ > 0 || !IsUndamped()) return FragileChain::TryStep();
    ++num_undamped_;
    step_ *= 0.5;
    return Chain::TryStep();
  }

 private:
  int num_undamped_ = 0;
};

TEST(LevenbergMarquardtTest, ReturnsToDampingIfUndampedStepsFail) {
  StiffChain chain(10000);
  const SolveSummary summary = MinimizeChain(0.5, 100, &chain);
  EXPECT_EQ(summary.termination, Termination::kConverged);
  const std::vector<double>& lambdas = chain.lambdas();
  ASSERT_EQ(lambdas.size(), 5u);
  for (const int i : {1, 2, 4}) EXPECT_EQ(lambdas[i], 1e-16) << i;
  EXPECT_LE(lambdas[3], lambdas[0]);
  EXPECT_GE(lambdas[3], 0.1 * lambdas[0]);
}

// A chain beside points that undamped steps move: the cost then decreases by
// more than the steps predict.
class ChainWithPoints : public Chain {
 public:
  using Chain::Chain;
  double Cost() override { return Chain::Cost() + cost_of_points_; }
  TrialStep TryStep() override {
    TrialStep step = Chain::TryStep();
    decrease_ = IsUndamped() ? 0.1 * cost_of_points_ : 0.0;
    step.new_cost += cost_of_points_ - decrease_;
    return step;
  }
  void AcceptStep() override {
    Chain::AcceptStep();
    cost_of_points_ -= decrease_;
  }

 private:
  double cost_of_points_ = 1.0;
  double decrease_ = 0.0;
};

TEST(LevenbergMarquardtTest, ConvergesIfUndampedStepsPredictNoDecrease) {
  Chain chain(20);
  ChainWithPoints with_points(20);
  const SolveSummary expected = MinimizeChain(1e-6, 100, &chain);
  const SolveSummary summary = MinimizeChain(1e-6, 100, &with_points, true);
  EXPECT_EQ(summary.termination, Termination::kConverged);
  EXPECT_LE(summary.num_iterations, expected.num_iterations + 2);
}

TEST(LevenbergMarquardtTest, DampingFallsFasterAfterConsecutiveGoodSteps) {
  Chain chain(10000);
  const SolveSummary summary = MinimizeChain(1e-14, 100, &chain);
  EXPECT_EQ(summary.termination, Termination::kConverged);
  EXPECT_LT(summary.final_cost, 1e-9 * summary.initial_cost);
  const std::vector<double>& lambdas = chain.lambdas();
  ASSERT_GT(lambdas.size(), 3u);
  for (size_t i = 0; i < lambdas.size(); ++i) {
    const double thirds = 0.5 * static_cast<double>(i * (i + 1));
    const double expected = lambdas[0] * std::pow(3.0, -thirds);
    EXPECT_NEAR(lambdas[i], std::max(expected, 1e-16), 1e-9 * expected);
  }
}

}  // namespace
}  // namespace mgsfm

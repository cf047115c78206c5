// SPDX-License-Identifier: BSD-3-Clause
#include "math/l1_admm.h"

#include <gtest/gtest.h>

#include <Eigen/LU>
#include <Eigen/QR>
#include <algorithm>
#include <cmath>
#include <limits>
#include <utility>
#include <vector>

#include "base/random.h"
#include "math/sparse_solver.h"
#include "math/statistics.h"

namespace mgsfm {
namespace {

using Eigen::MatrixXd;
using Eigen::VectorXd;

// f(z) = sum_kj w_k |z_kj|: weighted L1 norm.
struct L1Norm {
  VectorXd weights;

  double Cost(const MatrixXd& z) const {
    return weights.dot(z.cwiseAbs().rowwise().sum());
  }
  void Prox(double rho, const MatrixXd& v, MatrixXd* z) const {
    for (Eigen::Index j = 0; j < v.cols(); ++j) {
      for (Eigen::Index k = 0; k < v.rows(); ++k) {
        const double length = std::abs(v(k, j)) - weights[k] / rho;
        (*z)(k, j) = length > 0.0 ? std::copysign(length, v(k, j)) : 0.0;
      }
    }
  }
};

// The L1 norm of the first weights.size() rows, and the constraint z >= 0 on
// the remaining ones: C x >= d for the stacked systems [A; C] and [b; d].
// Cost() excludes the inequalities.
struct L1NormWithInequalities {
  VectorXd weights;

  double Cost(const MatrixXd& z) const {
    return weights.dot(z.topRows(weights.size()).cwiseAbs().rowwise().sum());
  }
  void Prox(double rho, const MatrixXd& v, MatrixXd* z) const {
    const Eigen::Index num_norms = weights.size();
    for (Eigen::Index j = 0; j < v.cols(); ++j) {
      for (Eigen::Index k = 0; k < num_norms; ++k) {
        const double length = std::abs(v(k, j)) - weights[k] / rho;
        (*z)(k, j) = length > 0.0 ? std::copysign(length, v(k, j)) : 0.0;
      }
      for (Eigen::Index k = num_norms; k < v.rows(); ++k) {
        (*z)(k, j) = std::max(v(k, j), 0.0);
      }
    }
  }
};

// f(z) = sum_k w_k min_{p in C_k} |z_k - p|_2: distances to convex sets of the
// 3-vectors stacked in the single column of z. Project(k, v) is the point of
// C_k nearest to v. For C_k = {s d_k, s >= l_k} this is the sum of |s_k d_k -
// z_k| over the optimal scales s_k >= l_k, which are eliminated from the
// unknowns.
template <class Project>
struct Distances3 {
  VectorXd weights;  // per 3-vector
  Project project;

  double Cost(const MatrixXd& z) const {
    double cost = 0.0;
    for (Eigen::Index k = 0; k < weights.size(); ++k) {
      const Eigen::Vector3d v = z.block<3, 1>(3 * k, 0);
      cost += weights[k] * (v - project(k, v)).norm();
    }
    return cost;
  }
  void Prox(double rho, const MatrixXd& v, MatrixXd* z) const {
    for (Eigen::Index k = 0; k < weights.size(); ++k) {
      const Eigen::Vector3d from = v.block<3, 1>(3 * k, 0);
      const Eigen::Vector3d nearest = project(k, from);
      const double distance = (from - nearest).norm();
      const double left = distance - weights[k] / rho;
      z->block<3, 1>(3 * k, 0) =
          nearest + (left > 0.0 ? left / distance : 0.0) * (from - nearest);
    }
  }
};

template <class Project>
Distances3<Project> MakeDistances3(VectorXd weights, Project project) {
  return {std::move(weights), std::move(project)};
}

MatrixXd RandomMatrix(int rows, int cols, Random* random) {
  return MatrixXd::NullaryExpr(rows, cols, [&] { return random->Normal(); });
}

AdmmOptions Accurate() {
  AdmmOptions options;
  options.max_num_iterations = 20000;
  options.relative_tolerance = 1e-7;
  return options;
}

// Visits all combinations of 3 of `size` rows.
template <class Visit>
void ForEachTriple(int size, const Visit& visit) {
  for (int i = 0; i < size; ++i) {
    for (int j = i + 1; j < size; ++j) {
      for (int k = j + 1; k < size; ++k) visit(i, j, k);
    }
  }
}

// The optimum of an L1 problem with three unknowns and inequality rows below
// the first `weights.size()` rows. At least one optimum is a vertex, where
// three rows hold with equality.
double BruteForceOptimum(const MatrixXd& A, const VectorXd& b,
                         const VectorXd& weights) {
  const Eigen::Index num_norms = weights.size();
  double best = std::numeric_limits<double>::infinity();
  ForEachTriple(static_cast<int>(A.rows()), [&](int i, int j, int k) {
    Eigen::Matrix3d M;
    M << A.row(i), A.row(j), A.row(k);
    const VectorXd x =
        M.fullPivLu().solve(Eigen::Vector3d(b[i], b[j], b[k])).eval();
    const VectorXd r = A * x - b;
    if ((r.tail(A.rows() - num_norms).array() < -1e-9).any()) return;
    best = std::min(best, weights.dot(r.head(num_norms).cwiseAbs()));
  });
  return best;
}

TEST(Admm, FindsMedians) {
  Random random(1);
  const int size = 101;
  const SparseLeastSquares op(MatrixXd::Ones(size, 1).sparseView());
  for (const double scale : {1e-6, 1.0, 1e4}) {
    MatrixXd b = scale * RandomMatrix(size, 3, &random).array().exp().matrix();
    b.array() += 3.0 * scale;
    AdmmState state;
    const SolveSummary summary =
        MinimizeByAdmm(op, b, L1Norm{VectorXd::Ones(size)}, Accurate(), &state);
    EXPECT_EQ(summary.termination, Termination::kConverged);
    for (int j = 0; j < 3; ++j) {
      const VectorXd column = b.col(j);
      EXPECT_NEAR(state.x(0, j), Median({column.begin(), column.end()}),
                  1e-4 * scale);
    }
  }
}

TEST(Admm, AgreesWithBruteForceL1Regression) {
  Random random(2);
  for (int trial = 0; trial < 10; ++trial) {
    const int rows = 25;
    const MatrixXd A = RandomMatrix(rows, 3, &random);
    MatrixXd b =
        A * RandomMatrix(3, 1, &random) + 0.01 * RandomMatrix(rows, 1, &random);
    for (int k = 0; k < 6; ++k) b(4 * k) += 10.0 * random.Normal();
    const VectorXd weights =
        VectorXd::NullaryExpr(rows, [&] { return random.Uniform(0.2, 2.0); });
    AdmmState state;
    const SparseLeastSquares op(A.sparseView());
    const SolveSummary summary =
        MinimizeByAdmm(op, b, L1Norm{weights}, Accurate(), &state);
    EXPECT_EQ(summary.termination, Termination::kConverged) << summary.message;
    const double optimum = BruteForceOptimum(A, b, weights);
    EXPECT_GE(summary.final_cost, optimum * (1.0 - 1e-9));
    EXPECT_LE(summary.final_cost, optimum * (1.0 + 1e-4));
    EXPECT_GE(summary.initial_cost, summary.final_cost);
  }
}

TEST(Admm, AgreesWithBruteForceUnderInequalities) {
  Random random(3);
  for (int trial = 0; trial < 10; ++trial) {
    const int num_norms = 18;
    const int rows = 24;
    const MatrixXd A = RandomMatrix(rows, 3, &random);
    MatrixXd b = RandomMatrix(rows, 1, &random);
    const VectorXd inside = RandomMatrix(3, 1, &random);
    for (int k = num_norms; k < rows; ++k) b(k) = A.row(k) * inside - 0.1;
    const VectorXd weights = VectorXd::Ones(num_norms);
    AdmmOptions options = Accurate();
    options.relative_tolerance = 1e-5;
    AdmmState state;
    const SparseLeastSquares op(A.sparseView());
    const SolveSummary summary =
        MinimizeByAdmm(op, b, L1NormWithInequalities{weights}, options, &state);
    EXPECT_EQ(summary.termination, Termination::kConverged) << summary.message;
    const VectorXd r = A * state.x - b;
    EXPECT_GE(r.tail(rows - num_norms).minCoeff(), -1e-4);
    const double optimum = BruteForceOptimum(A, b, weights);
    EXPECT_NEAR(summary.final_cost, optimum, 1e-3 * optimum);
  }
}

// Verifies both optimality conditions at the result from their definitions.
TEST(Admm, StoppingTestsHoldAtReturn) {
  Random random(4);
  const MatrixXd A = RandomMatrix(80, 6, &random);
  const MatrixXd b = RandomMatrix(80, 3, &random);
  const VectorXd weights = VectorXd::Constant(80, 0.3);
  const SparseLeastSquares op(A.sparseView());
  AdmmOptions options;
  AdmmState state;
  const SolveSummary summary =
      MinimizeByAdmm(op, b, RowNorms{weights}, options, &state);
  ASSERT_EQ(summary.termination, Termination::kConverged);
  const MatrixXd r = A * state.x - b;
  EXPECT_LE((r - state.z).norm(), 1.0001 * options.relative_tolerance *
                                      std::max(r.norm(), state.z.norm()));
  const MatrixXd Py = A * A.colPivHouseholderQr().solve(state.y);
  EXPECT_LE(Py.norm(),
            1.0001 * options.relative_tolerance * state.y.norm() + 1e-12);
  for (int k = 0; k < 80; ++k) {
    if (state.z.row(k).norm() < 1e-12) {
      EXPECT_LE(state.y.row(k).norm(), 0.3 * (1 + 1e-9));
    } else {
      EXPECT_LT((state.y.row(k) - 0.3 * state.z.row(k).normalized()).norm(),
                1e-9);
    }
  }
}

// Differences of positions along a chain. The first position is fixed.
struct ChainProblem {
  MatrixXd A;
  MatrixXd b;
};

ChainProblem MakeChain(int num_nodes, Random* random) {
  const int gaps[] = {1, 2, 3};
  std::vector<VectorXd> rows;
  std::vector<double> values;
  for (int i = 0; i < num_nodes; ++i) {
    for (const int gap : gaps) {
      if (i + gap >= num_nodes) continue;
      VectorXd row = VectorXd::Zero(num_nodes - 1);
      if (i > 0) row[i - 1] = -1.0;
      row[i + gap - 1] = 1.0;
      rows.push_back(row);
      const bool is_wrong = random->Uniform() < 0.2;
      values.push_back(
          gap + (is_wrong ? random->Normal() : 0.001 * random->Normal()));
    }
  }
  ChainProblem problem{MatrixXd(rows.size(), num_nodes - 1),
                       MatrixXd(rows.size(), 1)};
  for (size_t k = 0; k < rows.size(); ++k) {
    problem.A.row(k) = rows[k];
    problem.b(k) = values[k];
  }
  return problem;
}

TEST(Admm, ScalingTheDataScalesTheSolutionOnly) {
  Random random(5);
  const ChainProblem problem = MakeChain(20, &random);
  const SparseLeastSquares op(problem.A.sparseView());
  const L1Norm f{VectorXd::Ones(problem.b.rows())};
  AdmmState state;
  const SolveSummary summary =
      MinimizeByAdmm(op, problem.b, f, AdmmOptions(), &state);
  for (const double scale : {1e-3, 1e3}) {
    AdmmState scaled;
    const MatrixXd b = scale * problem.b;
    const SolveSummary scaled_summary =
        MinimizeByAdmm(op, b, f, AdmmOptions(), &scaled);
    EXPECT_EQ(scaled_summary.num_iterations, summary.num_iterations);
    EXPECT_LT((scaled.x / scale - state.x).norm(), 1e-9);
  }
}

TEST(Admm, ShiftingTheOriginShiftsTheSolutionOnly) {
  Random random(6);
  const MatrixXd A = RandomMatrix(40, 3, &random);
  const MatrixXd b = RandomMatrix(40, 1, &random);
  const SparseLeastSquares op(A.sparseView());
  const L1Norm f{VectorXd::Ones(40)};
  AdmmState state;
  const SolveSummary summary = MinimizeByAdmm(op, b, f, AdmmOptions(), &state);
  const MatrixXd shift = MatrixXd::Constant(3, 1, 1e4);
  AdmmState shifted;
  const SolveSummary shifted_summary =
      MinimizeByAdmm(op, b + A * shift, f, AdmmOptions(), &shifted);
  EXPECT_EQ(shifted_summary.num_iterations, summary.num_iterations);
  EXPECT_LT((shifted.x - shift - state.x).norm(), 1e-6);
}

// Outliers much smaller than 1 must not bias the solution towards least
// squares, as they would with a fixed penalty of 1.
TEST(Admm, RejectsOutliersBelowUnitSize) {
  Random random(7);
  ChainProblem problem = MakeChain(20, &random);
  const VectorXd truth = VectorXd::LinSpaced(19, 1.0, 19.0);
  problem.b = problem.A * truth;
  for (int k = 0; k < problem.b.rows(); k += 4) problem.b(k) += 0.1;
  const SparseLeastSquares op(problem.A.sparseView());
  AdmmState state;
  ASSERT_TRUE(MinimizeByAdmm(op, problem.b,
                             L1Norm{VectorXd::Ones(problem.b.rows())},
                             AdmmOptions(), &state)
                  .IsUsable());
  EXPECT_LT((state.x - truth).cwiseAbs().maxCoeff(), 1e-3);
}

TEST(Admm, ConsistentDataAreSolvedAtOnce) {
  Random random(8);
  const MatrixXd A = RandomMatrix(30, 4, &random);
  const MatrixXd x = RandomMatrix(4, 1, &random);
  AdmmState state;
  const SolveSummary summary =
      MinimizeByAdmm(SparseLeastSquares(A.sparseView()), A * x,
                     L1Norm{VectorXd::Ones(30)}, AdmmOptions(), &state);
  EXPECT_EQ(summary.termination, Termination::kConverged);
  EXPECT_EQ(summary.num_iterations, 0);
  EXPECT_LT((state.x - x).norm(), 1e-12);
}

TEST(Admm, WarmStartSavesIterations) {
  Random random(9);
  const ChainProblem problem = MakeChain(60, &random);
  const SparseLeastSquares op(problem.A.sparseView());
  const L1Norm f{VectorXd::Ones(problem.b.rows())};
  AdmmState state;
  const SolveSummary cold =
      MinimizeByAdmm(op, problem.b, f, AdmmOptions(), &state);
  const MatrixXd solution = state.x;
  const SolveSummary warm =
      MinimizeByAdmm(op, problem.b, f, AdmmOptions(), &state);
  EXPECT_EQ(warm.termination, Termination::kConverged);
  EXPECT_LT(warm.num_iterations, cold.num_iterations);
  EXPECT_LT((state.x - solution).norm(), 1e-2 * solution.norm());
}

// Positions from directions and minimum lengths. As b = 0, the least-squares
// start is zero and only the convex sets determine the scale.
TEST(Admm, DistancesToRaysGivePositionsUpToScale) {
  Random random(10);
  for (const double unit : {1e-4, 1.0, 1e3}) {
    const int num_nodes = 12;
    const MatrixXd truth = RandomMatrix(3, num_nodes, &random);
    std::vector<Eigen::Vector3d> directions;
    std::vector<Eigen::Triplet<double>> triplets;
    int row = 0;
    for (int i = 0; i < num_nodes; ++i) {
      for (int j = i + 1; j < num_nodes; ++j, row += 3) {
        directions.push_back((truth.col(j) - truth.col(i)).normalized());
        if (random.Uniform() < 0.15) {
          directions.back() = RandomMatrix(3, 1, &random).normalized();
        }
        for (int a = 0; a < 3; ++a) {
          triplets.emplace_back(row + a, 3 * (j - 1) + a, 1.0);
          if (i > 0) triplets.emplace_back(row + a, 3 * (i - 1) + a, -1.0);
        }
      }
    }
    Eigen::SparseMatrix<double> A(row, 3 * (num_nodes - 1));
    A.setFromTriplets(triplets.begin(), triplets.end());
    const auto f = MakeDistances3(
        VectorXd::Ones(row / 3),
        [&](Eigen::Index k, const Eigen::Vector3d& v) -> Eigen::Vector3d {
          return std::max(unit, v.dot(directions[k])) * directions[k];
        });
    AdmmState state;
    const SolveSummary summary = MinimizeByAdmm(
        SparseLeastSquares(A), MatrixXd::Zero(row, 1), f, Accurate(), &state);
    EXPECT_EQ(summary.termination, Termination::kConverged) << summary.message;
    const VectorXd expected =
        (truth.rightCols(num_nodes - 1).colwise() - truth.col(0)).reshaped();
    const VectorXd x = state.x;
    EXPECT_GT(x.dot(expected) / (x.norm() * expected.norm()), 1.0 - 1e-2);
    EXPECT_GT(x.norm(), 0.1 * unit);
  }
}

TEST(Admm, NotFiniteDataAreReportedAsFailure) {
  Random random(11);
  const MatrixXd A = RandomMatrix(10, 2, &random);
  MatrixXd b = RandomMatrix(10, 1, &random);
  b(3) = std::numeric_limits<double>::quiet_NaN();
  AdmmState state;
  EXPECT_FALSE(MinimizeByAdmm(SparseLeastSquares(A.sparseView()), b,
                              L1Norm{VectorXd::Ones(10)}, AdmmOptions(), &state)
                   .IsUsable());
}

}  // namespace
}  // namespace mgsfm

// SPDX-License-Identifier: BSD-3-Clause
#include "math/sparse_solver.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <Eigen/Cholesky>
#include <algorithm>
#include <cstdlib>
#include <limits>
#include <numeric>
#include <set>
#include <utility>
#include <vector>

#include "base/random.h"
#include "mgsfm/base/error.h"

namespace mgsfm {
namespace {

using Eigen::MatrixXd;
using SparseMatrix = Eigen::SparseMatrix<double>;

MatrixXd RandomMatrix(int rows, int cols, Random* random) {
  return MatrixXd::NullaryExpr(rows, cols, [&] { return random->Normal(); });
}

// A chain of nodes with some shortcuts: graph Laplacian plus `diagonal`.
SparseMatrix MakeMatrix(int size, double diagonal, Random* random) {
  std::vector<Eigen::Triplet<double>> triplets;
  const auto add_edge = [&](int i, int j) {
    const double weight = random->Uniform(0.5, 2.0);
    triplets.emplace_back(i, i, weight);
    triplets.emplace_back(j, j, weight);
    triplets.emplace_back(i, j, -weight);
    triplets.emplace_back(j, i, -weight);
  };
  for (int i = 0; i + 1 < size; ++i) add_edge(i, i + 1);
  for (int i = 0; i + 7 < size; i += 3) add_edge(i, i + 7);
  for (int i = 0; i < size; ++i) triplets.emplace_back(i, i, diagonal);
  SparseMatrix H(size, size);
  H.setFromTriplets(triplets.begin(), triplets.end());
  return H;
}

TEST(SparseCholesky, AgreesWithDense) {
  Random random(1);
  SparseCholesky solver;
  const SparseMatrix pattern = MakeMatrix(200, 1.0, &random);
  solver.Analyze(pattern);
  for (const double diagonal : {0.01, 3.0}) {
    const SparseMatrix H = MakeMatrix(200, diagonal, &random);
    ASSERT_TRUE(solver.Factorize(H));
    const MatrixXd B = RandomMatrix(200, 5, &random);
    MatrixXd X(200, 5);
    solver.Solve(B, X);
    EXPECT_LT((X - MatrixXd(H).llt().solve(B)).norm(), 1e-9 * X.norm());
    Eigen::VectorXd x(200);
    solver.Solve(B.col(2), x);
    EXPECT_LT((x - X.col(2)).norm(), 1e-12 * x.norm());
  }
}

TEST(SparseCholesky, ReadsLowerTriangleOnlyAndSolvesInPlace) {
  Random random(2);
  const SparseMatrix H = MakeMatrix(50, 0.5, &random);
  SparseMatrix lower = H.triangularView<Eigen::Lower>();
  SparseCholesky solver;
  solver.Analyze(lower);
  ASSERT_TRUE(solver.Factorize(lower));
  MatrixXd X = RandomMatrix(50, 2, &random);
  const MatrixXd B = X;
  solver.Solve(X, X);
  EXPECT_LT((H * X - B).norm(), 1e-10 * B.norm());
}

TEST(SparseCholesky, ReportsMatricesThatAreNotPositiveDefinite) {
  Random random(3);
  SparseMatrix H = MakeMatrix(60, 1.0, &random);
  SparseCholesky solver;
  solver.Analyze(H);
  H.coeffRef(30, 30) = -1.0;
  EXPECT_FALSE(solver.Factorize(H));
  EXPECT_EQ(solver.ReciprocalCondition(), 0.0);
  MatrixXd X(60, 1);
  EXPECT_THROW(solver.Solve(X, X), ContractError);
  H.coeffRef(30, 30) = std::numeric_limits<double>::quiet_NaN();
  EXPECT_FALSE(solver.Factorize(H));
  H.coeffRef(30, 30) = 9.0;
  EXPECT_TRUE(solver.Factorize(H));
}

TEST(SparseCholesky, ConditionTellsNearRankDeficiency) {
  Random random(4);
  SparseMatrix H = MakeMatrix(60, 1.0, &random);
  SparseCholesky solver;
  solver.Analyze(H);
  ASSERT_TRUE(solver.Factorize(H));
  EXPECT_GT(solver.ReciprocalCondition(), 1e-3);
  H = MakeMatrix(60, 1e-13, &random);
  if (solver.Factorize(H)) {
    EXPECT_LT(solver.ReciprocalCondition(), 1e-10);
  }
}

// 6 x 6 blocks on a chain with twelve neighbors per node and loops: dense
// enough for supernodes, some of them with several panels.
SparseMatrix MakeBlockMatrix(int num_nodes, int num_loops, Random* random) {
  constexpr int kSize = 6;
  std::vector<std::pair<int, int>> edges;
  for (int i = 0; i < num_nodes; ++i) {
    for (int j = i; j < std::min(i + 12, num_nodes); ++j) {
      edges.emplace_back(j, i);
    }
  }
  for (int k = 0; k < num_loops; ++k) {
    const int i = static_cast<int>(random->Index(num_nodes));
    const int j = static_cast<int>(random->Index(num_nodes));
    edges.emplace_back(std::max(i, j), std::min(i, j));
  }
  std::vector<Eigen::Triplet<double>> triplets;
  for (const auto& [row, column] : edges) {
    for (int a = 0; a < kSize; ++a) {
      for (int b = 0; b < kSize; ++b) {
        const int r = kSize * row + a, c = kSize * column + b;
        if (r < c) continue;
        triplets.emplace_back(r, c, r == c ? 30.0 : random->Uniform(-0.3, 0.3));
      }
    }
  }
  SparseMatrix H(kSize * num_nodes, kSize * num_nodes);
  H.setFromTriplets(triplets.begin(), triplets.end());
  return H;
}

TEST(SparseCholesky, SupernodesAgreeWithDense) {
  Random random(7);
  for (const int num_loops : {0, 10, 300}) {
    const SparseMatrix H = MakeBlockMatrix(90, num_loops, &random);
    const MatrixXd full = MatrixXd(H).selfadjointView<Eigen::Lower>();
    const MatrixXd B = RandomMatrix(static_cast<int>(H.rows()), 2, &random);
    const MatrixXd expected = full.llt().solve(B);
    for (const auto order : {SparseCholesky::Order::kFillReducing,
                             SparseCholesky::Order::kNatural}) {
      SparseCholesky solver(2);
      solver.Analyze(H, order);
      MatrixXd X(B.rows(), B.cols());
      for (int repeat = 0; repeat < 2; ++repeat) {
        ASSERT_TRUE(solver.Factorize(H));
        solver.Solve(B, X);
        EXPECT_LT((X - expected).norm(), 1e-12 * expected.norm());
      }
    }
  }
}

TEST(SparseCholesky, ThreadsDoNotChangeSupernodes) {
  Random random(8);
  const SparseMatrix H = MakeBlockMatrix(150, 60, &random);
  const MatrixXd b = RandomMatrix(static_cast<int>(H.rows()), 1, &random);
  MatrixXd expected(b.rows(), 1);
  for (int num_threads = 1; num_threads <= 5; ++num_threads) {
    SparseCholesky solver(num_threads);
    solver.Analyze(H, SparseCholesky::Order::kNatural);
    ASSERT_TRUE(solver.Factorize(H));
    MatrixXd x(b.rows(), 1);
    solver.Solve(b, x);
    if (num_threads == 1) expected = x;
    EXPECT_EQ(x, expected) << num_threads;
  }
}

TEST(SparseCholesky, SupernodesReportMatricesThatAreNotPositiveDefinite) {
  Random random(9);
  SparseMatrix H = MakeBlockMatrix(90, 30, &random);
  SparseCholesky solver(3);
  solver.Analyze(H);
  for (const int i : {0, 100, 539}) {
    for (const double bad : {-1.0, std::numeric_limits<double>::quiet_NaN(),
                             std::numeric_limits<double>::infinity()}) {
      H.coeffRef(i, i) = bad;
      EXPECT_FALSE(solver.Factorize(H)) << i << ' ' << bad;
    }
    H.coeffRef(i, i) = 30.0;
    EXPECT_TRUE(solver.Factorize(H));
  }
}

TEST(SparseCholesky, IsMovable) {
  Random random(5);
  const SparseMatrix H = MakeMatrix(20, 1.0, &random);
  SparseCholesky solver;
  solver.Analyze(H);
  SparseCholesky moved = std::move(solver);
  EXPECT_TRUE(moved.Factorize(H));
}

// A square grid in which each node is connected to its eight neighbors.
SparseMatrix MakeGrid(int side) {
  std::vector<Eigen::Triplet<double>> triplets;
  for (int i = 0; i < side * side; ++i) {
    for (int j = 0; j < side * side; ++j) {
      if (std::abs(i / side - j / side) > 1) continue;
      if (std::abs(i % side - j % side) > 1) continue;
      triplets.emplace_back(i, j, i == j ? 9.0 : -1.0);
    }
  }
  SparseMatrix H(side * side, side * side);
  H.setFromTriplets(triplets.begin(), triplets.end());
  return H;
}

// The number of entries of the factor including the diagonal, by symbolic
// elimination of one unknown after the other.
size_t CountFactorEntries(const SparseMatrix& H,
                          const std::vector<int>& order) {
  std::vector<std::set<int>> neighbors(H.cols());
  for (int j = 0; j < H.outerSize(); ++j) {
    for (SparseMatrix::InnerIterator it(H, j); it; ++it) {
      if (it.row() != j) neighbors[j].insert(static_cast<int>(it.row()));
    }
  }
  size_t num_entries = 0;
  for (const int i : order) {
    num_entries += 1 + neighbors[i].size();
    for (const int a : neighbors[i]) {
      neighbors[a].erase(i);
      for (const int b : neighbors[i]) {
        if (a != b) neighbors[a].insert(b);
      }
    }
  }
  return num_entries;
}

TEST(EliminationOrder, CostsWhatItSaysAndLessThanTheOrderOfRows) {
  const SparseMatrix H = MakeGrid(25);
  const EliminationOrder found = FindEliminationOrder(H);
  std::vector<int> rows(H.rows());
  std::iota(rows.begin(), rows.end(), 0);
  ASSERT_THAT(found.order, testing::UnorderedElementsAreArray(rows));
  const size_t num_entries = CountFactorEntries(H, found.order);
  EXPECT_EQ(found.num_factor_entries, num_entries);
  EXPECT_LT(num_entries, CountFactorEntries(H, rows));
}

TEST(EliminationOrder, IsTheSameEachTime) {
  const SparseMatrix H = MakeGrid(20);
  EXPECT_EQ(FindEliminationOrder(H).order, FindEliminationOrder(H).order);
}

TEST(SparseLeastSquares, SolvesNormalEquations) {
  Random random(6);
  const MatrixXd dense = RandomMatrix(30, 8, &random);
  const SparseLeastSquares op(dense.sparseView());
  ASSERT_TRUE(op.IsPositiveDefinite());
  const MatrixXd x = RandomMatrix(8, 2, &random);
  MatrixXd y, g, solution;
  op.Apply(x, &y);
  op.ApplyTranspose(y, &g);
  op.SolveNormal(g, &solution);
  EXPECT_LT((solution - x).norm(), 1e-10);
}

TEST(SparseLeastSquares, RankDeficiencyIsReported) {
  Random random(7);
  MatrixXd dense = RandomMatrix(30, 8, &random);
  dense.col(3).setZero();
  EXPECT_FALSE(SparseLeastSquares(dense.sparseView()).IsPositiveDefinite());
}

}  // namespace
}  // namespace mgsfm

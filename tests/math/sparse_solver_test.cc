// SPDX-License-Identifier: BSD-3-Clause
#include "mgsfm/math/sparse_solver.h"

#include <gtest/gtest.h>

#include <Eigen/Cholesky>
#include <limits>
#include <utility>
#include <vector>

#include "mgsfm/base/error.h"
#include "mgsfm/base/random.h"

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

TEST(SparseCholesky, IsMovable) {
  Random random(5);
  const SparseMatrix H = MakeMatrix(20, 1.0, &random);
  SparseCholesky solver;
  solver.Analyze(H);
  SparseCholesky moved = std::move(solver);
  EXPECT_TRUE(moved.Factorize(H));
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

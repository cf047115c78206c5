// SPDX-License-Identifier: BSD-3-Clause
#include "translation_averaging/arrow_least_squares.h"

#include <gtest/gtest.h>

#include <Eigen/Geometry>
#include <vector>

#include "base/random.h"

namespace mgsfm {
namespace {

using Eigen::Matrix3d;
using Eigen::MatrixXd;
using SparseMatrix = Eigen::SparseMatrix<double>;

Matrix3d RandomRotation(Random* random) {
  return Eigen::Quaterniond(random->Normal(), random->Normal(),
                            random->Normal(), random->Normal())
      .normalized()
      .toRotationMatrix();
}

// Turned and weighted differences of points, and of `num_border` more unknowns.
SparseMatrix MakeMatrix(int num_points, int num_border, Random* random) {
  std::vector<Eigen::Triplet<double>> triplets;
  int row = 0;
  const auto add = [&](int column, const Matrix3d& block) {
    for (int r = 0; r < 3; ++r) {
      for (int c = 0; c < 3; ++c) {
        triplets.emplace_back(row + r, column + c, block(r, c));
      }
    }
  };
  for (int i = 0; i < num_points; ++i) {
    for (const int j : {i - 1, i - 2, i - 7}) {
      const Matrix3d rows = random->Uniform(0.5, 2.0) * RandomRotation(random);
      add(3 * i, rows);
      if (j >= 0) add(3 * j, -rows);
      for (int k = 0; k < num_border; ++k) {
        triplets.emplace_back(row + k % 3, 3 * num_points + k,
                              random->Normal());
      }
      row += 3;
    }
  }
  SparseMatrix A(row, 3 * num_points + num_border);
  A.setFromTriplets(triplets.begin(), triplets.end());
  return A;
}

TEST(ArrowLeastSquares, AgreesWithDense) {
  Random random(1);
  for (const int num_border : {0, 1, 7}) {
    const SparseMatrix A = MakeMatrix(60, num_border, &random);
    const MatrixXd dense = A;
    const MatrixXd x =
        MatrixXd::NullaryExpr(A.cols(), 1, [&] { return random.Normal(); });
    const MatrixXd y =
        MatrixXd::NullaryExpr(A.rows(), 1, [&] { return random.Normal(); });
    MatrixXd first;
    for (int num_threads = 1; num_threads <= 3; ++num_threads) {
      const ArrowLeastSquares op(A, 60, num_threads);
      ASSERT_TRUE(op.IsPositiveDefinite());
      MatrixXd Ax, Aty, solved;
      op.Apply(x, &Ax);
      op.ApplyTranspose(y, &Aty);
      op.SolveNormal(x, &solved);
      EXPECT_LT((Ax - dense * x).norm(), 1e-12 * Ax.norm());
      EXPECT_LT((Aty - dense.transpose() * y).norm(), 1e-12 * Aty.norm());
      EXPECT_LT((dense.transpose() * (dense * solved) - x).norm(),
                1e-9 * x.norm());
      if (num_threads == 1) first = solved;
      EXPECT_EQ(solved, first);
    }
  }
}

TEST(ArrowLeastSquares, NoPoints) {
  Random random(2);
  SparseMatrix A(6, 2);
  for (int i = 0; i < 6; ++i) A.insert(i, i % 2) = 1.0 + i;
  const ArrowLeastSquares op(A, 0, 2);
  ASSERT_TRUE(op.IsPositiveDefinite());
  MatrixXd x;
  op.SolveNormal(MatrixXd::Ones(2, 1), &x);
  EXPECT_LT((MatrixXd(A).transpose() * (A * x) - MatrixXd::Ones(2, 1)).norm(),
            1e-12);
}

TEST(ArrowLeastSquares, RankDeficiencyIsReported) {
  Random random(3);
  SparseMatrix A = MakeMatrix(20, 1, &random);
  SparseMatrix twice(A.rows(), A.cols() + 1);
  twice.leftCols(A.cols()) = A;
  EXPECT_FALSE(ArrowLeastSquares(twice, 20, 1).IsPositiveDefinite());
}

}  // namespace
}  // namespace mgsfm

// SPDX-License-Identifier: BSD-3-Clause
#include "bundle/interior_elimination.h"

#include <gtest/gtest.h>

#include <Eigen/Cholesky>
#include <cmath>

#include "base/random.h"

namespace mgsfm {
namespace {

using Eigen::MatrixXd;
using Eigen::VectorXd;

// Positive definite, as dense or as sparse as a chain.
MatrixXd RandomSystem(int size, int bandwidth, Random* random) {
  const MatrixXd J = MatrixXd::NullaryExpr(
      2 * size, size, [&](Eigen::Index row, Eigen::Index column) {
        return std::abs(row / 2 - column) <= bandwidth ? random->Normal() : 0.0;
      });
  return J.transpose() * J + 0.1 * MatrixXd::Identity(size, size);
}

MatrixXd Block(const MatrixXd& H, const std::vector<int>& rows,
               const std::vector<int>& columns) {
  return H(rows, columns);
}

// Unknown 7 does not move.
void ExpectEliminates(int size, int bandwidth) {
  Random random(bandwidth);
  const MatrixXd H = RandomSystem(size, bandwidth, &random);
  const VectorXd b =
      VectorXd::NullaryExpr(size, [&] { return random.Normal(); });
  std::vector<int> interior, shared;
  for (int i = 0; i < size; ++i) {
    if (i != 7) (i % 5 == 0 ? shared : interior).push_back(i);
  }
  const Eigen::SparseMatrix<double> lower =
      MatrixXd(H.triangularView<Eigen::Lower>()).sparseView();
  InteriorElimination elimination(interior, shared, 1);
  MatrixXd reduced;
  VectorXd reduced_b;
  ASSERT_TRUE(elimination.Reduce(lower, b, &reduced, &reduced_b));
  const Eigen::LLT<MatrixXd> own(Block(H, interior, interior));
  const MatrixXd coupling = Block(H, interior, shared);
  const MatrixXd expected =
      Block(H, shared, shared) - coupling.transpose() * own.solve(coupling);
  reduced = MatrixXd(reduced.selfadjointView<Eigen::Lower>());
  EXPECT_LT((reduced - expected).norm(), 1e-10 * H.norm());
  const VectorXd expected_b =
      b(shared) - coupling.transpose() * own.solve(VectorXd(b(interior)));
  EXPECT_LT((reduced_b - expected_b).norm(), 1e-10 * b.norm());

  const VectorXd z_shared = expected.llt().solve(expected_b);
  VectorXd z;
  ASSERT_TRUE(elimination.Expand(lower, b, z_shared, &z));
  EXPECT_EQ(z[7], 0.0);
  VectorXd residual = H * z - b;
  residual[7] = 0.0;
  EXPECT_LT(residual.norm(), 1e-9 * b.norm());
}

// Simplicial and supernodal factors.
TEST(InteriorElimination, ReducesAndExpandsAsDenseMatrices) {
  ExpectEliminates(40, 1);
  ExpectEliminates(120, 60);
}

TEST(InteriorElimination, BlockOfItsOwnUnknownsSolvesThem) {
  Random random(3);
  const MatrixXd H = RandomSystem(12, 3, &random);
  const VectorXd b = VectorXd::Ones(12);
  std::vector<int> interior;
  for (int i = 0; i < 12; ++i) interior.push_back(i);
  InteriorElimination elimination(interior, {}, 1);
  MatrixXd reduced;
  VectorXd reduced_b, z;
  ASSERT_TRUE(elimination.Reduce(H.sparseView(), b, &reduced, &reduced_b));
  EXPECT_EQ(reduced.size(), 0);
  ASSERT_TRUE(elimination.Expand(H.sparseView(), b, VectorXd(), &z));
  EXPECT_LT((H * z - b).norm(), 1e-10);
}

TEST(InteriorElimination, IndefiniteMatrixIsReported) {
  MatrixXd H = -MatrixXd::Identity(4, 4);
  InteriorElimination elimination({0, 1}, {2, 3}, 1);
  MatrixXd reduced;
  VectorXd reduced_b, z;
  EXPECT_FALSE(elimination.Reduce(H.sparseView(), VectorXd::Ones(4), &reduced,
                                  &reduced_b));
  EXPECT_FALSE(elimination.Expand(H.sparseView(), VectorXd::Ones(4),
                                  VectorXd::Ones(2), &z));
}

}  // namespace
}  // namespace mgsfm

// SPDX-License-Identifier: BSD-3-Clause
#include "math/in_place_cholesky.h"

#include <gtest/gtest.h>

#include <Eigen/Cholesky>
#include <algorithm>
#include <cstdlib>
#include <limits>
#include <vector>

#include "base/random.h"

namespace mgsfm {
namespace {

using Eigen::MatrixXd;
using Eigen::VectorXd;

// A chain of dense blocks and a border, which is in postorder. Each block meets
// the next one, whose supernode has other rows.
class BlockChain {
 public:
  BlockChain(int num_blocks, int block_size, int border_size, double diagonal)
      : H_(MatrixXd::Zero(num_blocks * block_size + border_size,
                          num_blocks * block_size + border_size)) {
    Random random(1);
    const auto size = static_cast<int>(H_.rows());
    const int border = num_blocks * block_size;
    const auto meet = [&](int i, int j) {
      const int distance = std::abs(i / block_size - j / block_size);
      return i >= border || j >= border || distance <= 1;
    };
    const MatrixXd A =
        MatrixXd::NullaryExpr(size, 2 * size, [&] { return random.Normal(); });
    const MatrixXd all = A * A.transpose() / size;
    for (int j = 0; j < size; ++j) {
      column_begin_.push_back(static_cast<int>(rows_.size()));
      for (int i = j; i < size; ++i) {
        if (!meet(i, j)) continue;
        rows_.push_back(i);
        H_(i, j) = H_(j, i) = 0.1 * all(i, j);
      }
      H_(j, j) += diagonal;
    }
    column_begin_.push_back(static_cast<int>(rows_.size()));
  }

  const MatrixXd& H() const { return H_; }
  void Analyze(InPlaceCholesky* solver) const {
    solver->Analyze(column_begin_, rows_);
  }
  void SetValues(const MatrixXd& H, InPlaceCholesky* solver) const {
    std::fill_n(solver->values(), solver->num_values(), 0.0);
    for (int j = 0; j < H.cols(); ++j) {
      for (int k = column_begin_[j]; k < column_begin_[j + 1]; ++k) {
        const int i = rows_[k];
        solver->values()[solver->Find(i, j).position] = H(i, j);
      }
    }
  }

 private:
  MatrixXd H_;
  std::vector<int> column_begin_, rows_;
};

TEST(InPlaceCholesky, AgreesWithDenseForEveryNumberOfThreads) {
  const BlockChain chain(30, 6, 8, 3.0);
  const VectorXd b = VectorXd::LinSpaced(chain.H().rows(), -1.0, 2.0);
  VectorXd one;
  for (const int num_threads : {1, 3}) {
    InPlaceCholesky solver(num_threads);
    chain.Analyze(&solver);
    // The second matrix must not depend on the factor of the first.
    for (const double scale : {1.0, 2.0}) {
      chain.SetValues(scale * chain.H(), &solver);
      ASSERT_TRUE(solver.Factorize());
      VectorXd x = b;
      solver.Solve(x);
      EXPECT_LT((scale * chain.H() * x - b).norm(), 1e-10 * b.norm());
      if (num_threads == 1) one = x;
      if (num_threads > 1 && scale == 2.0) {
        EXPECT_EQ(x, one);
      }
    }
  }
}

// Values above the diagonal of a block are not read.
TEST(InPlaceCholesky, ReadsLowerTriangleOnly) {
  const BlockChain chain(10, 6, 0, 3.0);
  InPlaceCholesky solver(1);
  chain.Analyze(&solver);
  chain.SetValues(chain.H(), &solver);
  const auto [position, stride] = solver.Find(6, 6);
  solver.values()[position + stride] = 1e3;  // row 6 of column 7
  ASSERT_TRUE(solver.Factorize());
  const VectorXd b = VectorXd::Ones(60);
  VectorXd x = b;
  solver.Solve(x);
  EXPECT_LT((chain.H() * x - b).norm(), 1e-10 * b.norm());
}

TEST(InPlaceCholesky, BlocksAreInOnePiece) {
  const BlockChain chain(10, 6, 8, 3.0);
  InPlaceCholesky solver(1);
  chain.Analyze(&solver);
  const auto first = solver.Find(12, 6);
  for (int i = 0; i < 6; ++i) {
    for (int j = 0; j < 6; ++j) {
      EXPECT_EQ(solver.Find(12 + i, 6 + j).position,
                first.position + i + static_cast<size_t>(j) * first.stride);
    }
  }
}

TEST(InPlaceCholesky, ReportsMatricesThatAreNotPositiveDefinite) {
  const BlockChain chain(10, 6, 4, 3.0);
  InPlaceCholesky solver(2);
  chain.Analyze(&solver);
  MatrixXd H = chain.H();
  for (const double bad : {-1.0, std::numeric_limits<double>::quiet_NaN(),
                           std::numeric_limits<double>::infinity()}) {
    H(30, 30) = bad;
    chain.SetValues(H, &solver);
    EXPECT_FALSE(solver.Factorize());
  }
  chain.SetValues(chain.H(), &solver);
  EXPECT_TRUE(solver.Factorize());
}

}  // namespace
}  // namespace mgsfm

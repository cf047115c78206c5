// SPDX-License-Identifier: BSD-3-Clause
#include "bundle/block_reduction.h"

#include <algorithm>

#include "least_squares/damping.h"

namespace mgsfm {
namespace {

// Columns of B^T that are solved for at a time; bounds the memory.
constexpr int kColumnsPerSolve = 48;

using Triplets = std::vector<Eigen::Triplet<double>>;

Eigen::SparseMatrix<double> MakeSparse(int rows, int columns,
                                       const Triplets& triplets) {
  Eigen::SparseMatrix<double> matrix(rows, columns);
  matrix.setFromTriplets(triplets.begin(), triplets.end());
  return matrix;
}

}  // namespace

SplitSystem::SplitSystem(const BuiltProblem& built,
                         const SharedUnknowns& shared,
                         const RigEquationsBase& equations, int num_threads)
    : equations_(equations), solver_(num_threads) {
  NumberUnknowns(built, shared);
  SplitMatrix();
  if (num_inner_ > 0) solver_.Analyze(A_, SparseCholesky::Order::kNatural);
  is_usable_ = num_inner_ == 0 || solver_.Factorize(A_);
}

void SplitSystem::NumberUnknowns(const BuiltProblem& built,
                                 const SharedUnknowns& shared) {
  const RigStructure& s = equations_.structure();
  std::vector<int> shared_of(s.num_unknowns, -1);
  const auto share_pose = [&](int block, int first) {
    if (block == kNoBlock || first < 0) return;
    for (int k = 0; k < s.pose_size; ++k) {
      shared_of[s.block_first[block] + k] = first + 6 - s.pose_size + k;
    }
  };
  for (size_t i = 0; i < built.frame_idxs.size(); ++i) {
    share_pose(s.frame_block[i], shared.first_of_frame[built.frame_idxs[i]]);
  }
  for (size_t i = 0; i < built.sensor_idxs.size(); ++i) {
    share_pose(s.sensor_block[i], shared.first_of_sensor[built.sensor_idxs[i]]);
  }
  for (size_t i = 0; i < built.camera_idxs.size(); ++i) {
    if (s.camera_block[i] == kNoBlock) continue;
    const std::vector<int>& params = built.problem.cameras[i].free_params;
    for (size_t k = 0; k < params.size(); ++k) {
      shared_of[s.block_first[s.camera_block[i]] + k] =
          shared.first_of_camera[built.camera_idxs[i]] + params[k];
    }
  }
  for (const int unknown : shared_of) {
    const bool is_shared = unknown >= 0;
    inner_row_.push_back(is_shared ? -1 : num_inner_++);
    shared_row_.push_back(is_shared ? static_cast<int>(shared_unknowns_.size())
                                    : -1);
    if (is_shared) shared_unknowns_.push_back(unknown);
  }
}

void SplitSystem::SplitMatrix() {
  const auto num_shared = static_cast<int>(shared_unknowns_.size());
  const Eigen::SparseMatrix<double>& H = equations_.matrix();
  const Eigen::VectorXd rhs = equations_.RightHandSide();
  a_.resize(num_inner_);
  b_.resize(num_shared);
  C_ = Eigen::MatrixXd::Zero(num_shared, num_shared);
  Triplets inner, mixed;
  inner.reserve(static_cast<size_t>(H.nonZeros()));
  for (int column = 0; column < H.cols(); ++column) {
    const int inner_column = inner_row_[column];
    const int shared_column = shared_row_[column];
    (inner_column >= 0 ? a_[inner_column] : b_[shared_column]) = rhs[column];
    for (Eigen::SparseMatrix<double>::InnerIterator it(H, column); it; ++it) {
      const auto row = static_cast<int>(it.row());
      if (row < column) continue;
      const bool row_is_inner = inner_row_[row] >= 0;
      if (row_is_inner && inner_column >= 0) {
        inner.emplace_back(inner_row_[row], inner_column, it.value());
      } else if (inner_column >= 0) {
        mixed.emplace_back(inner_column, shared_row_[row], it.value());
      } else if (row_is_inner) {
        mixed.emplace_back(inner_row_[row], shared_column, it.value());
      } else {
        C_(shared_row_[row], shared_column) = it.value();
      }
    }
  }
  A_ = MakeSparse(num_inner_, num_inner_, inner);
  Bt_ = MakeSparse(num_inner_, num_shared, mixed);
}

ReducedBlock SplitSystem::Reduce() const {
  ReducedBlock reduced{shared_unknowns_, C_, b_, {}};
  const auto num_shared = static_cast<int>(shared_unknowns_.size());
  reduced.damping.resize(num_shared);
  for (size_t i = 0; i < shared_row_.size(); ++i) {
    if (shared_row_[i] < 0) continue;
    const double value = equations_.diagonal()[static_cast<Eigen::Index>(i)];
    reduced.damping[shared_row_[i]] = value > 0.0 ? ClampDiagonal(value) : 0.0;
  }
  if (num_inner_ == 0) return reduced;
  Eigen::MatrixXd columns;
  for (int begin = 0; begin < num_shared; begin += kColumnsPerSolve) {
    const int count = std::min(kColumnsPerSolve, num_shared - begin);
    columns = Bt_.middleCols(begin, count);
    solver_.Solve(columns, columns);
    reduced.matrix.middleCols(begin, count) -= Bt_.transpose() * columns;
  }
  Eigen::VectorXd inner(num_inner_);
  solver_.Solve(a_, inner);
  reduced.rhs -= Bt_.transpose() * inner;
  return reduced;
}

Eigen::VectorXd SplitSystem::CompleteStep(
    const Eigen::VectorXd& shared_step) const {
  Eigen::VectorXd shared(shared_unknowns_.size());
  for (Eigen::Index i = 0; i < shared.size(); ++i) {
    shared[i] = shared_step[shared_unknowns_[static_cast<size_t>(i)]];
  }
  Eigen::VectorXd inner = a_ - Bt_ * shared;
  if (num_inner_ > 0) solver_.Solve(inner, inner);
  Eigen::VectorXd step(static_cast<Eigen::Index>(inner_row_.size()));
  for (Eigen::Index i = 0; i < step.size(); ++i) {
    const auto k = static_cast<size_t>(i);
    step[i] =
        inner_row_[k] >= 0 ? inner[inner_row_[k]] : shared[shared_row_[k]];
  }
  return step;
}

}  // namespace mgsfm

// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <Eigen/Core>
#include <Eigen/SparseCore>
#include <cstddef>
#include <vector>

#include "math/sparse_solver.h"
#include "rig_solver/rig_structure.h"

namespace mgsfm {

// The Schur complement of a rig problem, or its preconditioner, in the pattern
// of the structure, and its factor.
class SchurComplement {
 public:
  explicit SchurComplement(int num_threads);

  // Allocates the matrix when first called.
  void Allocate(const RigStructure& structure);

  // BlockPattern::Find() of the structure returns the positions.
  double* values() { return matrix_.valuePtr(); }
  size_t num_values() const { return static_cast<size_t>(matrix_.nonZeros()); }
  void SetZero();
  // The diagonal entry of unknown i.
  double& Diagonal(Eigen::Index i) { return values()[diagonal_position_[i]]; }

  [[nodiscard]] bool Factorize() { return solver_.Factorize(matrix_); }
  // X must have the size of B and may alias it.
  template <class Matrix>
  void Solve(const Eigen::Ref<const Eigen::MatrixXd>& B, Matrix* X) const {
    solver_.Solve(B, *X);
  }

 private:
  const int num_threads_;
  bool is_allocated_ = false;
  std::vector<size_t> diagonal_position_;  // in the values
  Eigen::SparseMatrix<double> matrix_;
  SparseCholesky solver_;
};

}  // namespace mgsfm

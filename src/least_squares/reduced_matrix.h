// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <Eigen/Core>
#include <Eigen/SparseCore>
#include <cstddef>
#include <vector>

#include "least_squares/rig_structure.h"
#include "math/in_place_cholesky.h"
#include "math/sparse_solver.h"

namespace mgsfm {

// The reduced matrix of a rig problem, or its preconditioner, in the pattern of
// the structure, and its factor. In place, both share their memory: Factorize()
// overwrites the matrix.
class ReducedMatrix {
 public:
  ReducedMatrix(bool is_in_place, int num_threads);

  // Allocates the matrix when first called. In place, this moves the places of
  // the pattern and of chunk_pairs.
  void Allocate(RigStructure* structure);

  // BlockPattern::Find() of the structure gives the places. In place, there are
  // more values than the pattern has.
  double* values() {
    return is_in_place_ ? in_place_.values() : matrix_.valuePtr();
  }
  size_t num_values() const {
    return is_in_place_ ? in_place_.num_values()
                        : static_cast<size_t>(matrix_.nonZeros());
  }
  void SetZero();
  // The diagonal entry of unknown i.
  double& Diagonal(Eigen::Index i) { return values()[diagonal_position_[i]]; }

  [[nodiscard]] bool Factorize() {
    return is_in_place_ ? in_place_.Factorize() : solver_.Factorize(matrix_);
  }
  // X must have the size of B and may alias it.
  void Solve(const Eigen::Ref<const Eigen::MatrixXd>& B,
             Eigen::Ref<Eigen::MatrixXd> X) const;

 private:
  const bool is_in_place_;
  const int num_threads_;
  bool is_allocated_ = false;
  std::vector<size_t> diagonal_position_;  // in the values
  Eigen::SparseMatrix<double> matrix_;
  SparseCholesky solver_;
  InPlaceCholesky in_place_;
};

}  // namespace mgsfm

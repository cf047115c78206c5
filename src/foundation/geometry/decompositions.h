// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <Eigen/Core>

namespace mgsfm {

// Decompositions by Eigen that many files need. Each file that instantiates one
// takes seconds longer to compile, so they are compiled here only.

// A = V diag(values) V^T of a symmetric matrix; eigenvalues are in ascending
// order. For Matrix2d, Matrix3d, Matrix4d and MatrixXd.
template <class Matrix>
struct SymmetricEigen {
  explicit SymmetricEigen(const Matrix& A);

  Eigen::Matrix<double, Matrix::RowsAtCompileTime, 1> values;
  Matrix V;
};

// A = U diag(values) V^T; singular values are in descending order.
struct Svd3 {
  explicit Svd3(const Eigen::Matrix3d& A);

  Eigen::Matrix3d U, V;
  Eigen::Vector3d values;
};

}  // namespace mgsfm

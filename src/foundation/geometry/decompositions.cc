// SPDX-License-Identifier: BSD-3-Clause
#include "geometry/decompositions.h"

#include <Eigen/Eigenvalues>
#include <Eigen/SVD>

namespace mgsfm {

template <class Matrix>
SymmetricEigen<Matrix>::SymmetricEigen(const Matrix& A) {
  const Eigen::SelfAdjointEigenSolver<Matrix> solver(A);
  values = solver.eigenvalues();
  V = solver.eigenvectors();
}

template struct SymmetricEigen<Eigen::Matrix2d>;
template struct SymmetricEigen<Eigen::Matrix3d>;
template struct SymmetricEigen<Eigen::Matrix4d>;
template struct SymmetricEigen<Eigen::MatrixXd>;

Svd3::Svd3(const Eigen::Matrix3d& A) {
  const Eigen::JacobiSVD<Eigen::Matrix3d> svd(
      A, Eigen::ComputeFullU | Eigen::ComputeFullV);
  U = svd.matrixU();
  V = svd.matrixV();
  values = svd.singularValues();
}

}  // namespace mgsfm

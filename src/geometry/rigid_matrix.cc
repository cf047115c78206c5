// SPDX-License-Identifier: BSD-3-Clause
#include "geometry/rigid_matrix.h"

#include <Eigen/LU>

namespace mgsfm {

std::optional<Rigid3> RigidFromMatrix(const RigidMatrix& b_from_a) {
  // Matrices in text files with four digits deviate by at most 4e-4.
  constexpr double kTolerance = 1e-3;
  const Eigen::Matrix3d rotation = b_from_a.leftCols<3>();
  const bool is_rotation =
      b_from_a.allFinite() && rotation.determinant() > 0.0 &&
      (rotation * rotation.transpose() - Eigen::Matrix3d::Identity()).norm() <
          kTolerance;
  if (!is_rotation) return std::nullopt;
  return Rigid3{Eigen::Quaterniond(rotation).normalized(), b_from_a.col(3)};
}

}  // namespace mgsfm

// SPDX-License-Identifier: BSD-3-Clause
#include "geometry/rigid_matrix.h"

#include <Eigen/Geometry>
#include <Eigen/LU>

namespace mgsfm {

std::optional<Rigid3> RigidFromMatrix(const RigidMatrix& b_from_a) {
  const Eigen::Matrix3d rotation = b_from_a.leftCols<3>();
  const bool is_rotation =
      b_from_a.allFinite() && rotation.determinant() > 0.0 &&
      (rotation * rotation.transpose() - Eigen::Matrix3d::Identity()).norm() <
          kFourDigitTolerance;
  if (!is_rotation) return std::nullopt;
  return Rigid3{Eigen::Quaterniond(rotation).normalized(), b_from_a.col(3)};
}

std::optional<Rigid3> RigidFromNumbers(const std::vector<double>& b_from_a) {
  if (b_from_a.size() != 12 && b_from_a.size() != 16) return std::nullopt;
  if (b_from_a.size() == 16) {
    const Eigen::Map<const Eigen::RowVector4d> last(b_from_a.data() + 12);
    if ((last - Eigen::RowVector4d::UnitW()).norm() > kFourDigitTolerance) {
      return std::nullopt;
    }
  }
  return RigidFromMatrix(Eigen::Map<const RigidMatrix>(b_from_a.data()));
}

std::optional<Rigid3> RigidFromRotation(const double* b_from_a) {
  RigidMatrix matrix = RigidMatrix::Zero();
  matrix.leftCols<3>() =
      Eigen::Map<const Eigen::Matrix<double, 3, 3, Eigen::RowMajor>>(b_from_a);
  return RigidFromMatrix(matrix);
}

Eigen::Quaterniond FromOrderXyzw(const Eigen::Quaterniond& read_as_wxyz) {
  return {read_as_wxyz.z(), read_as_wxyz.w(), read_as_wxyz.x(),
          read_as_wxyz.y()};
}

}  // namespace mgsfm

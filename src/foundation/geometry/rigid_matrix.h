// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <Eigen/Core>
#include <optional>
#include <vector>

#include "mgsfm/geometry/rigid3.h"

namespace mgsfm {

// b_from_a as [R | t].
using RigidMatrix = Eigen::Matrix<double, 3, 4, Eigen::RowMajor>;

// Rotations of text files with four digits deviate by at most 4e-4: matrices
// from an orthogonal one, quaternions from length one.
inline constexpr double kFourDigitTolerance = 1e-3;

// R is made orthogonal. nullopt if R R^T deviates from the identity by more
// than kFourDigitTolerance.
std::optional<Rigid3> RigidFromMatrix(const RigidMatrix& b_from_a);

// The same for the numbers of a matrix of 3 or 4 rows, in row-major order.
// nullopt also if the fourth row is not 0 0 0 1, as in a transposed matrix.
std::optional<Rigid3> RigidFromNumbers(const std::vector<double>& b_from_a);

// The same for the nine numbers of R in row-major order, without translation.
std::optional<Rigid3> RigidFromRotation(const double* b_from_a);

// The rotation of a quaternion in the order x, y, z, w whose numbers were read
// as w, x, y, z.
Eigen::Quaterniond FromOrderXyzw(const Eigen::Quaterniond& read_as_wxyz);

}  // namespace mgsfm

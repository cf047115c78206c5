// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <Eigen/Core>
#include <optional>

#include "mgsfm/geometry/rigid3.h"

namespace mgsfm {

// b_from_a as [R | t].
using RigidMatrix = Eigen::Matrix<double, 3, 4, Eigen::RowMajor>;

// R is made orthogonal. nullopt if it is no rotation: R R^T deviates from the
// identity by more than 1e-3, which files with four digits stay below.
std::optional<Rigid3> RigidFromMatrix(const RigidMatrix& b_from_a);

}  // namespace mgsfm

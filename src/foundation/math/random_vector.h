// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <Eigen/Core>

#include "base/random.h"

namespace mgsfm {

// A vector of independent standard normal coordinates. Its direction is
// uniformly distributed.
inline Eigen::Vector3d NormalVector(Random* random) {
  return {random->Normal(), random->Normal(), random->Normal()};
}

}  // namespace mgsfm

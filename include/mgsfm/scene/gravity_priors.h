// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <Eigen/Core>
#include <optional>
#include <vector>

namespace mgsfm {

// The direction of gravity, measured by an inertial sensor: per image, a unit
// vector in the camera frame, (0, 1, 0) for an upright camera. Gravity points
// along +y in a levelled world.
struct GravityPriors {
  std::vector<std::optional<Eigen::Vector3d>> images;  // empty: no priors

  bool IsEmpty() const { return images.empty(); }
};

}  // namespace mgsfm

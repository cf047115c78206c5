// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <Eigen/Core>
#include <optional>
#include <vector>

namespace mgsfm {

// The direction of gravity as an inertial sensor measures it: per image, a unit
// vector in the camera frame, (0, 1, 0) for an upright camera. Models that are
// levelled by it have gravity along +y.
struct GravityPriors {
  std::vector<std::optional<Eigen::Vector3d>> images;  // empty: none

  bool IsEmpty() const { return images.empty(); }
};

}  // namespace mgsfm

// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <Eigen/Core>
#include <optional>
#include <vector>

namespace mgsfm {

// The direction of gravity, as an inertial sensor measures it: per image, a
// unit vector in the frame of its camera, (0, 1, 0) if that is upright. Worlds
// that are levelled by it have gravity along +y, as upright cameras have.
struct GravityPriors {
  std::vector<std::optional<Eigen::Vector3d>> images;  // empty: none

  bool IsEmpty() const { return images.empty(); }
};

}  // namespace mgsfm

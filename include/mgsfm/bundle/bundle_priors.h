// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <Eigen/Core>
#include <optional>

#include "mgsfm/scene/gravity_priors.h"
#include "mgsfm/scene/position_priors.h"

namespace mgsfm {

// The gravity terms of bundle adjustment: measured directions in images, and
// the direction in the world of the model that they are compared with.
struct GravityTerms {
  GravityPriors priors;
  Eigen::Vector3d down_in_world = Eigen::Vector3d::UnitY();  // unit vector
  double sigma_rad = 1.0;  // of each of the two angles of a direction
};

// The measurements beyond keypoints that bundle adjustment uses. Positions must
// be in the world of the model. Empty: none.
struct BundlePriors {
  PositionPriors positions;
  std::optional<GravityTerms> gravity;
};

}  // namespace mgsfm

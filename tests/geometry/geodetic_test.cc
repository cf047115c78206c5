// SPDX-License-Identifier: BSD-3-Clause
#include "geometry/geodetic.h"

#include <gtest/gtest.h>

#include <cmath>

namespace mgsfm {
namespace {

TEST(EastNorthUp, HasMetresAlongItsAxes) {
  const Eigen::Vector3d origin(49.0, 8.4, 110.0);
  EXPECT_LT(EastNorthUp(origin, origin).norm(), 1e-9);
  // A minute of latitude is a nautical mile; a minute of longitude is shorter
  // by the cosine of the latitude.
  const Eigen::Vector3d north =
      EastNorthUp(origin + Eigen::Vector3d(1.0 / 60.0, 0.0, 0.0), origin);
  EXPECT_NEAR(north.y(), 1852.0, 6.0);
  EXPECT_NEAR(north.x(), 0.0, 1e-6);
  const Eigen::Vector3d east =
      EastNorthUp(origin + Eigen::Vector3d(0.0, 1.0 / 60.0, 0.0), origin);
  EXPECT_NEAR(east.x(), 1855.3 * std::cos(49.0 * 3.14159265 / 180.0), 5.0);
  const Eigen::Vector3d up =
      EastNorthUp(origin + Eigen::Vector3d(0.0, 0.0, 7.0), origin);
  EXPECT_LT((up - Eigen::Vector3d(0.0, 0.0, 7.0)).norm(), 1e-6);
}

}  // namespace
}  // namespace mgsfm

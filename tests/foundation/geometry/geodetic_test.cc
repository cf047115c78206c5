// SPDX-License-Identifier: BSD-3-Clause
#include "geometry/geodetic.h"

#include <gtest/gtest.h>

#include <cmath>

namespace mgsfm {
namespace {

TEST(EastNorthUp, HasMetersAlongItsAxes) {
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

// The poles and the equator are at the half axes of the ellipsoid, and every
// origin gives the same place.
TEST(EarthFromEastNorthUp, HasTheAxesOfTheEarth) {
  const auto earth = [](const Eigen::Vector3d& place,
                        const Eigen::Vector3d& origin) {
    return EarthFromEastNorthUp(origin) * EastNorthUp(place, origin);
  };
  const Eigen::Vector3d origin(47.0, 8.0, 400.0), other(-33.0, 151.0, 20.0);
  EXPECT_LT(
      (earth({0.0, 0.0, 0.0}, origin) - Eigen::Vector3d(6378137.0, 0.0, 0.0))
          .norm(),
      1e-6);
  EXPECT_LT(
      (earth({0.0, 90.0, 3.0}, origin) - Eigen::Vector3d(0.0, 6378140.0, 0.0))
          .norm(),
      1e-6);
  EXPECT_LT((earth({90.0, 0.0, 0.0}, origin) -
             Eigen::Vector3d(0.0, 0.0, 6356752.314245))
                .norm(),
            1e-5);
  const Eigen::Vector3d place(46.5, 8.3, 1000.0);
  EXPECT_LT((earth(place, origin) - earth(place, other)).norm(), 1e-6);
}

}  // namespace
}  // namespace mgsfm

// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <Eigen/Core>

#include "mgsfm/geometry/rigid3.h"

namespace mgsfm {

// Converts latitude and longitude (degrees) and height above the WGS84
// ellipsoid (meters) to the local east-north-up frame (meters) of an origin in
// the same coordinates.
Eigen::Vector3d EastNorthUp(const Eigen::Vector3d& latitude_longitude_altitude,
                            const Eigen::Vector3d& origin);

// The inverse, to 1e-9 m within 10,000 km of the ellipsoid.
Eigen::Vector3d LatitudeLongitudeAltitude(const Eigen::Vector3d& east_north_up,
                                          const Eigen::Vector3d& origin);

// The transform from the east-north-up frame of an origin to the earth-centered
// frame of WGS84: x towards the meridian of Greenwich, z towards the north pole
// (m).
Rigid3 EarthFromEastNorthUp(const Eigen::Vector3d& origin);

}  // namespace mgsfm

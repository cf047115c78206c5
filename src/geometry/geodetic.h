// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <Eigen/Core>

namespace mgsfm {

// Latitude and longitude (degrees) and height above the WGS84 ellipsoid
// (metres), in metres east, north and up of a point that is given alike, on the
// plane that touches the ellipsoid there.
Eigen::Vector3d EastNorthUp(const Eigen::Vector3d& latitude_longitude_altitude,
                            const Eigen::Vector3d& origin);

}  // namespace mgsfm

// SPDX-License-Identifier: BSD-3-Clause
#include "geometry/geodetic.h"

#include <cmath>

#include "geometry/so3.h"

namespace mgsfm {
namespace {

// The WGS84 ellipsoid.
constexpr double kSemiMajorAxis_m = 6378137.0;
constexpr double kFlattening = 1.0 / 298.257223563;

Eigen::Vector3d EarthCentered(const Eigen::Vector3d& position) {
  const double latitude = DegToRad(position.x());
  const double longitude = DegToRad(position.y());
  const double squared_eccentricity = kFlattening * (2.0 - kFlattening);
  const double sine = std::sin(latitude);
  const double radius =
      kSemiMajorAxis_m / std::sqrt(1.0 - squared_eccentricity * sine * sine);
  const double from_axis = (radius + position.z()) * std::cos(latitude);
  return {from_axis * std::cos(longitude), from_axis * std::sin(longitude),
          (radius * (1.0 - squared_eccentricity) + position.z()) * sine};
}

}  // namespace

Eigen::Vector3d EastNorthUp(const Eigen::Vector3d& latitude_longitude_altitude,
                            const Eigen::Vector3d& origin) {
  const Eigen::Vector3d d =
      EarthCentered(latitude_longitude_altitude) - EarthCentered(origin);
  const double latitude = DegToRad(origin.x());
  const double longitude = DegToRad(origin.y());
  const Eigen::Vector3d east(-std::sin(longitude), std::cos(longitude), 0.0);
  const Eigen::Vector3d up(std::cos(latitude) * std::cos(longitude),
                           std::cos(latitude) * std::sin(longitude),
                           std::sin(latitude));
  return {east.dot(d), up.cross(east).dot(d), up.dot(d)};
}

}  // namespace mgsfm

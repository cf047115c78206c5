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

// The earth-centered east, north and up axes at an origin, as columns.
Eigen::Matrix3d LocalAxes(const Eigen::Vector3d& origin) {
  const double latitude = DegToRad(origin.x());
  const double longitude = DegToRad(origin.y());
  Eigen::Matrix3d axes;
  axes.col(0) << -std::sin(longitude), std::cos(longitude), 0.0;
  axes.col(2) << std::cos(latitude) * std::cos(longitude),
      std::cos(latitude) * std::sin(longitude), std::sin(latitude);
  axes.col(1) = axes.col(2).cross(axes.col(0));
  return axes;
}

}  // namespace

Eigen::Vector3d EastNorthUp(const Eigen::Vector3d& latitude_longitude_altitude,
                            const Eigen::Vector3d& origin) {
  const Eigen::Vector3d d =
      EarthCentered(latitude_longitude_altitude) - EarthCentered(origin);
  return LocalAxes(origin).transpose() * d;
}

Eigen::Vector3d LatitudeLongitudeAltitude(const Eigen::Vector3d& east_north_up,
                                          const Eigen::Vector3d& origin) {
  const Eigen::Vector3d p =
      EarthCentered(origin) + LocalAxes(origin) * east_north_up;
  const double squared_eccentricity = kFlattening * (2.0 - kFlattening);
  const double from_axis = p.head<2>().norm();
  double latitude = std::atan2(p.z(), from_axis * (1.0 - squared_eccentricity));
  double radius = kSemiMajorAxis_m;
  // Each step reduces the error of the latitude by the squared eccentricity.
  for (int i = 0; i < 10; ++i) {
    const double sine = std::sin(latitude);
    radius =
        kSemiMajorAxis_m / std::sqrt(1.0 - squared_eccentricity * sine * sine);
    latitude =
        std::atan2(p.z() + squared_eccentricity * radius * sine, from_axis);
  }
  // Valid at the poles, too, where the distance from the axis is zero.
  const double sine = std::sin(latitude);
  const double altitude = from_axis * std::cos(latitude) + p.z() * sine -
                          radius * (1.0 - squared_eccentricity * sine * sine);
  return {RadToDeg(latitude), RadToDeg(std::atan2(p.y(), p.x())), altitude};
}

Rigid3 EarthFromEastNorthUp(const Eigen::Vector3d& origin) {
  return {Eigen::Quaterniond(LocalAxes(origin)), EarthCentered(origin)};
}

}  // namespace mgsfm

// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <Eigen/Core>
#include <optional>
#include <vector>

namespace mgsfm {

// A measured position, as by GPS, in metres or the unit of its world.
struct PositionMeasurement {
  Eigen::Vector3d position = Eigen::Vector3d::Zero();
  Eigen::Matrix3d covariance = Eigen::Matrix3d::Identity();
};

// The direction of gravity in images, a unit vector in the camera, and in the
// world.
struct MeasuredGravity {
  std::vector<std::optional<Eigen::Vector3d>> images;
  Eigen::Vector3d down = Eigen::Vector3d::UnitY();
  double sigma_rad = 1.0;
};

// Where images were taken, as measured: of their camera centres, in one common
// world.
struct PositionPriors {
  std::vector<std::optional<PositionMeasurement>> images;  // empty: none
  // Latitude and longitude (degrees, WGS84) and altitude (metres) of the origin
  // of the world if that is local: x east, y north, z up.
  std::optional<Eigen::Vector3d> origin_wgs84;
  // For bundle adjustment, which may have this alone.
  std::optional<MeasuredGravity> gravity;

  bool IsEmpty() const { return images.empty(); }  // of positions
};

}  // namespace mgsfm

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

// Where images were taken, as measured: of their camera centres, in one common
// world.
struct PositionPriors {
  std::vector<std::optional<PositionMeasurement>> images;  // empty: none
  // Latitude and longitude (degrees, WGS84) and altitude (metres) of the origin
  // of the world if that is local: x east, y north, z up.
  std::optional<Eigen::Vector3d> origin_wgs84;

  bool IsEmpty() const { return images.empty(); }
};

}  // namespace mgsfm

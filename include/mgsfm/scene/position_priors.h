// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <Eigen/Core>
#include <optional>
#include <vector>

namespace mgsfm {

// The measured position of a camera centre, for example by GPS, in metres or
// in the unit of its world.
struct PositionMeasurement {
  Eigen::Vector3d position = Eigen::Vector3d::Zero();
  Eigen::Matrix3d covariance = Eigen::Matrix3d::Identity();
};

// Measured positions of the camera centres of images, in one common world.
struct PositionPriors {
  std::vector<std::optional<PositionMeasurement>> images;  // empty: none
  // Latitude and longitude (degrees, WGS84) and altitude (metres) of the origin
  // if the world is a local tangent plane: x east, y north, z up.
  std::optional<Eigen::Vector3d> origin_wgs84;

  bool IsEmpty() const { return images.empty(); }
};

}  // namespace mgsfm

// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <Eigen/Core>
#include <optional>
#include <vector>

namespace mgsfm {

// A measured position, e.g. by GPS, in metres or the unit of its world.
struct PositionMeasurement {
  Eigen::Vector3d position = Eigen::Vector3d::Zero();
  Eigen::Matrix3d covariance = Eigen::Matrix3d::Identity();
};

// The measured direction of gravity. All directions are unit vectors.
struct MeasuredGravity {
  std::vector<std::optional<Eigen::Vector3d>> images;  // in the camera
  Eigen::Vector3d down = Eigen::Vector3d::UnitY();     // in the world
  double sigma_rad = 1.0;
};

// Measured positions of camera centres in one common world frame.
struct PositionPriors {
  std::vector<std::optional<PositionMeasurement>> images;  // empty: no priors
  // For local worlds with x east, y north and z up: latitude and longitude
  // (degrees, WGS84) and altitude (metres) of the origin.
  std::optional<Eigen::Vector3d> origin_wgs84;
  // For bundle adjustment; available without positions, too.
  std::optional<MeasuredGravity> gravity;

  bool IsEmpty() const { return images.empty(); }  // of positions
};

}  // namespace mgsfm

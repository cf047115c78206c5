// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <Eigen/Core>
#include <optional>
#include <string>
#include <vector>

#include "mgsfm/base/fields.h"
#include "mgsfm/geometry/rigid3.h"

namespace mgsfm {

// The measured position of a point that is fixed to a camera, for example by
// GPS, in meters or in the unit of its world.
struct PositionMeasurement {
  Eigen::Vector3d position = Eigen::Vector3d::Zero();
  Eigen::Matrix3d covariance = Eigen::Matrix3d::Identity();
  // The antenna has the measured position and the axes of its body. By default,
  // it is the camera itself.
  Rigid3 cam_from_antenna = {};

  // From the camera center to the antenna. Its length is that of the antenna in
  // a world of any scale.
  Eigen::Vector3d LeverInWorld(const Rigid3& cam_from_world) const {
    return cam_from_world.rotation.conjugate() * cam_from_antenna.translation;
  }
  // The antenna in a model with the unit of length of the position.
  Eigen::Vector3d PointInWorld(const Rigid3& cam_from_world) const {
    return cam_from_world.Center() + LeverInWorld(cam_from_world);
  }
};

// Measured positions of points that are fixed to the cameras of images, in one
// world frame.
struct PositionPriors {
  std::vector<std::optional<PositionMeasurement>> images;  // empty: none
  // Latitude and longitude (degrees, WGS84) and altitude (meters) of the origin
  // if the world is a local tangent plane: x east, y north, z up.
  std::optional<Eigen::Vector3d> origin_wgs84;
  // Rejected positions at latitude 0, longitude 0, which receivers write when
  // they have no fix.
  int num_null_fixes = 0;

  bool IsEmpty() const { return images.empty(); }
};

// The direction of gravity as measured by an inertial sensor: per image, a unit
// vector in the camera frame, (0, 1, 0) for an upright camera. Models that are
// leveled by it have gravity along +y.
struct GravityPriors {
  std::vector<std::optional<Eigen::Vector3d>> images;  // empty: none

  bool IsEmpty() const { return images.empty(); }
};
inline const GravityPriors kNoGravity;

// The extent of a pose-graph deformation: the largest displacement, in the unit
// of the positions, and rotation of a frame. See
// src/estimation/georegistration/pose_graph_deformation.h.
struct ModelDeformation {
  double max_shift = 0.0;
  double max_rotation_deg = 0.0;

  auto Fields() const {
    return Named("max_shift", max_shift, "max_rotation_deg", max_rotation_deg);
  }
};

// The place of the antenna, as the motion of the rig determines it.
struct AntennaEstimate {
  // The offset from the given place, in the axes of the antenna. It is zero
  // along directions in which chance exceeds it in 1 of 10,000 recordings.
  Eigen::Vector3d offset = Eigen::Vector3d::Zero();
  double sigma = 0.0;  // of the length

  // The positions as those of this place.
  PositionPriors Move(PositionPriors positions) const {
    for (auto& prior : positions.images) {
      if (!prior) continue;
      Rigid3& pose = prior->cam_from_antenna;
      pose.translation = pose * offset;
    }
    return positions;
  }
  auto Fields() const {
    return Named("offset", std::vector<double>(offset.begin(), offset.end()),
                 "sigma", sigma);
  }
};

// The use of measured positions in one model. Lengths are in the unit of the
// positions.
struct PositionPriorSummary {
  struct Outlier {
    int image_idx = 0;
    double distance = 0.0;  // from the position to its point of the model

    auto Fields() const {
      return Named("image", As<Item::kImageName>(image_idx), "distance",
                   distance);
    }
  };
  bool is_registered = false;  // the model is in the world of the positions
  std::string message;         // why it is not registered, or what was assumed
  int num_priors = 0;          // of images registered before the alignment
  int num_used = 0;
  std::optional<AntennaEstimate> antenna;       // if requested
  std::optional<ModelDeformation> deformation;  // nullopt: not needed
  std::optional<double> rms;  // distance of the used positions
  // Not used, or more than 4 standard deviations from the final model.
  std::vector<Outlier> outliers;

  auto Fields() const {
    return Named("is_registered", is_registered, "message", message,
                 "num_priors", num_priors, "num_used", num_used, "rms", rms,
                 "antenna", antenna, "deformation", deformation, "outliers",
                 outliers);
  }
};

// The agreement of measured directions of gravity with estimated rotations.
struct GravitySummary {
  struct Outlier {
    int image_idx = 0;
    double error_deg = 0.0;

    auto Fields() const {
      return Named("image", As<Item::kImageName>(image_idx), "error_deg",
                   error_deg);
    }
  };
  int num_priors = 0;  // of images with a rotation
  // The assumed standard deviation, or the robust estimate if it is larger.
  double sigma_deg = 0.0;
  std::optional<double> median_error_deg;
  std::vector<Outlier> outliers;

  auto Fields() const {
    return Named("num_priors", num_priors, "median_error_deg", median_error_deg,
                 "outliers", outliers);
  }
};

}  // namespace mgsfm

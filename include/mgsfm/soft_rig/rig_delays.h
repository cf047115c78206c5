// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <Eigen/Core>
#include <cmath>
#include <optional>
#include <string>
#include <vector>

#include "mgsfm/base/fields.h"
#include "mgsfm/scene/estimates.h"

namespace mgsfm {

// A camera against the reference of its rig.
struct CameraDelay {
  int sensor_idx = 0;
  double delay = 0.0;  // positive: it triggers later than the reference
  double sigma = 0.0;
  // Chance exceeds the delay in 1 of 10,000 cameras.
  bool is_certain = false;
  // The variance of the pose in the rig by blocks of frames, relative to that
  // of independent residuals.
  double overdispersion = 1.0;
  // The same by points: the observations of one may err alike in all frames.
  double overdispersion_of_points = 1.0;

  auto Fields() const {
    return Named("camera", As<Item::kSensorName>(sensor_idx), "delay", delay,
                 "sigma", sigma, "is_certain", is_certain, "overdispersion",
                 overdispersion, "overdispersion_of_points",
                 overdispersion_of_points);
  }
};

// The error of the unit of length of a model, which a known rig or baseline
// defines.
struct UnitError {
  // The logarithm of the factor by which lengths of the model are too small, if
  // cameras may be late and known poses are as uncertain as their priors.
  double log_factor = 0.0;
  double sigma = 0.0;
  // Chance exceeds log_factor in 1 of 10,000 models.
  bool is_certain = false;

  // The standard deviation about the unit of the model.
  double RelativeSigma() const { return std::hypot(log_factor, sigma); }

  auto Fields() const {
    return Named("log_factor", log_factor, "sigma", sigma, "is_certain",
                 is_certain);
  }
};

// What the residuals of an adjusted model tell of the synchronism and the
// rigidity of its rigs; see docs/maths/soft_rig.md.
struct RigDelays {
  bool is_in_seconds = false;        // otherwise in intervals of frames
  std::vector<CameraDelay> cameras;  // those that are not references
  // Per frame: the angular velocity of the rig, in the rig.
  std::vector<Eigen::Vector3d> angular_velocities;
  // The model with these delays; without points. Frames and sensors only.
  Reconstruction delayed;
  std::optional<UnitError> unit;  // only if a length is known

  auto Fields() const {
    return Named("unit", std::string(is_in_seconds ? "s" : "frame intervals"),
                 "cameras", cameras);
  }

  bool AreCertain() const {
    for (const CameraDelay& camera : cameras) {
      if (camera.is_certain) return true;
    }
    return false;
  }
};

}  // namespace mgsfm

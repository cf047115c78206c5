// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <cmath>
#include <optional>
#include <string>
#include <vector>

#include "mgsfm/base/fields.h"
#include "mgsfm/scene/estimates.h"

namespace mgsfm {

// The delay of a camera relative to the reference sensor of its rig.
struct CameraDelay {
  int sensor_idx = 0;
  double delay = 0.0;  // positive: triggers after the reference
  double sigma = 0.0;
  // Whether the delay is significant: chance exceeds it in 1 of 10,000 cameras,
  // and the delays of all cameras together move keypoints by more than a tenth
  // of their noise (root mean square).
  bool is_certain = false;
  // The variance of the sensor pose from the scatter between blocks of frames,
  // divided by the variance for independent residuals.
  double overdispersion = 1.0;
  // The same ratio by points: all observations of a point may err alike.
  double overdispersion_of_points = 1.0;

  auto Fields() const {
    return Named("camera", As<Item::kSensorName>(sensor_idx), "delay", delay,
                 "sigma", sigma, "is_certain", is_certain, "overdispersion",
                 overdispersion, "overdispersion_of_points",
                 overdispersion_of_points);
  }
};

// The scale error of a model whose unit of length is defined by a known rig or
// baseline.
struct UnitError {
  // The logarithm of the factor by which lengths of the model are too small,
  // estimated with camera delays and with known poses as uncertain as their
  // priors.
  double log_factor = 0.0;
  double sigma = 0.0;
  // Whether log_factor is significant: chance exceeds it in 1 of 10,000 models.
  bool is_certain = false;

  // The standard deviation of lengths about the unit of the model.
  double RelativeSigma() const { return std::hypot(log_factor, sigma); }

  auto Fields() const {
    return Named("log_factor", log_factor, "sigma", sigma, "is_certain",
                 is_certain);
  }
};

// Synchronization and rigidity of the rigs, estimated from the residuals of an
// adjusted model; see docs/maths/soft_rig.md.
struct RigDelays {
  bool is_in_seconds = false;        // otherwise in frame intervals
  std::vector<CameraDelay> cameras;  // all but the reference cameras
  // The frames, sensors and motions of the model with these delays, without
  // points.
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

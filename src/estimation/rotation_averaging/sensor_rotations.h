// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <Eigen/Geometry>
#include <optional>
#include <vector>

#include "mgsfm/rotation_averaging/rotation_averaging.h"
#include "mgsfm/scene/scene.h"

namespace mgsfm {

// Rotations of single images, ignoring rigs. Each connected component has its
// own world.
struct ImageRotations {
  std::vector<std::optional<Eigen::Quaterniond>> cam_from_world;  // per image
  std::vector<int> component;                                     // per image
  std::vector<double> support;  // per image: matches in consistent pairs
};

struct SensorRotations {
  std::vector<std::optional<Eigen::Quaterniond>> sensor_from_rig;
  std::vector<SensorRotationSummary> summaries;
};

// The sensor_from_rig rotations S_k (step 2 of rotation_averaging.h).
//
// A sensor is determined once S_k is known. Each frame with images of an
// undetermined sensor k and a determined sensor a in the same component gives a
// sample R_k R_a^T S_a; a is the sensor of the frame that was determined first.
// The sensor with most samples is next: S_k is the geodesic L1 median of its
// samples, each weighted with the smaller support of its two images. The result
// is rejected if the median deviation of the samples exceeds max_error_deg.
//
// If no sensor has samples, hand-eye calibration is tried with all pairs of
// frames in which sensor k is in one component and determined sensors are in
// another. The result is rejected if the rotations about the second axis are
// below min_hand_eye_rotation_deg, the median error exceeds max_error_deg, or
// the uncertainty exceeds max_error_deg / 5.
SensorRotations EstimateSensorRotations(
    const Scene& scene, const ImageRotations& images,
    const RotationAveragingOptions& options);

}  // namespace mgsfm

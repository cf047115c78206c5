// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <Eigen/Geometry>
#include <optional>
#include <vector>

#include "mgsfm/rotation/rotation_averaging.h"
#include "mgsfm/scene/scene.h"

namespace mgsfm {

// Rotations of single images, without regard to rigs. Each connected part has
// its own world.
struct ImageRotations {
  std::vector<std::optional<Eigen::Quaterniond>> cam_from_world;  // per image
  std::vector<int> component;                                     // per image
  std::vector<double> support;  // per image: matches in consistent pairs
};

struct SensorRotations {
  std::vector<std::optional<Eigen::Quaterniond>> sensor_from_rig;
  std::vector<SensorRotationSummary> summaries;
};

// The internal rotations S_k (step 2 of rotation_averaging.h).
//
// A sensor is determined once S_k is known. While there is one with frames in
// which it has an image in the same part as that of a determined sensor a, the
// one with most such frames is next: S_k is the geodesic L1 median over these
// frames of R_k R_a^T S_a, a the first of the frame's sensors to have been
// determined, weighted with the smaller support of the two images. It is
// refused if more than half of the samples are max_error_deg away.
//
// Where there is none, hand-eye calibration is tried with all pairs of frames
// in which sensor k is in one part and determined sensors are in one other. It
// is refused if the second axis, the error or the uncertainty is beyond the
// limits (min_hand_eye_rotation_deg; max_error_deg; a fifth of that).
SensorRotations EstimateSensorRotations(
    const Scene& scene, const ImageRotations& images,
    const RotationAveragingOptions& options);

}  // namespace mgsfm

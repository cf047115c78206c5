// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <Eigen/Geometry>
#include <optional>
#include <vector>

#include "input_check/rig_samples.h"
#include "mgsfm/input_check/finding.h"
#include "mgsfm/input_check/kept_matches.h"
#include "mgsfm/scene/scene.h"
#include "mgsfm/scene/view_graph.h"

namespace mgsfm {

// Tests whether the cameras of a rig move alike. The rotation vectors w of two
// cameras between the same two frames obey w_b = S w_a, where S is the
// (unknown) rotation of b relative to a. If camera b is late by k frames, w_b(f
// + k, g + k) = S w_a(f, g). S is fitted for each k; only pairs of one camera
// are used, so cameras need not overlap.
struct MotionAgreement {
  int sensor_a = 0;
  int sensor_b = 0;
  int num_motions = 0;  // at lag 0
  double mean_motion_rad = 0.0;
  int best_lag = 0;  // frames
  // Trimmed mean of |w_b - S w_a| at lag 0 and at the best lag.
  double error_rad = 0.0;
  double best_error_rad = 0.0;
  // Fraction of the motions with a smaller error at the best lag than at lag 0.
  double share_better = 0.0;
  // Standard deviation of the rotations of both cameras, from the errors of
  // cycles of three frames.
  double noise_rad = 0.0;
  // A camera with mirrored images rotates like one turned by 180 degrees, but
  // translates in the opposite direction. If the rig turns about the vertical
  // axis only, it looks like an upside-down camera.
  bool is_mirrored = false;
  // S, if its standard deviation is below 10 degrees.
  std::optional<Eigen::Quaterniond> b_from_a;
  // Angles between w_b and S w_a at lag 0, for the known S of the scene (empty
  // if unknown) and for the fitted S.
  std::vector<double> axis_to_known_rad, axis_to_fitted_rad;
};

// Compares each sensor with the sensor of its rig that has most motions.
std::vector<MotionAgreement> CompareMotions(const Scene& scene,
                                            const ViewGraph& view_graph);

// kCameraLag, kForeignCamera and kMirroredCamera, where the motions exceed
// their noise. `samples` provide the rotation on which the pairs between two
// cameras agree. Pairs with mirrored images agree on none, or, if all see one
// scene from one place, on a rotation that the motions contradict.
//
// Lever arms move the cameras of a turning rig in different directions. If a
// model with a rigid rig explains most matches of both cameras, opposite
// directions do not indicate mirrored images. `kept` is null without a model.
std::vector<Finding> CheckMotions(const Scene& scene,
                                  const ViewGraph& view_graph,
                                  const std::vector<SensorPairSamples>& samples,
                                  const KeptMatches* kept);

}  // namespace mgsfm

// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <Eigen/Core>
#include <optional>
#include <string>
#include <vector>

#include "mgsfm/base/context.h"
#include "mgsfm/bundle/bundle_adjustment.h"
#include "mgsfm/geometry/rigid3.h"
#include "mgsfm/scene/estimates.h"
#include "mgsfm/scene/scene.h"

namespace mgsfm {

// How exact the poses of an adjusted model are, as far as the noise of its
// observations tells: sigma^2 (J^T W J)^-1 for the objective (1) of
// bundle_adjustment.h at the model, with sigma the noise of the keypoints as
// bundle adjustment estimates it, and priors weighted as they are given.
// Intrinsics that are held count as exact, and so do all poses that are held;
// measured gravity is left out.
//
// Coordinates of a pose are a turn (radians, R <- Exp(w) R) and a shift: of a
// sensor, both in axes of its camera (S, t); of a frame, the turn in axes of
// the rig, the shift of its centre in axes of the world.
//
// Gauge: that of bundle adjustment. Covariances of frames are relative to the
// frame that is held, and lengths, if nothing gives their unit, to the one
// coordinate that is.

// A direction in which a sensor or a frame could be anywhere: its standard
// deviation is more than 10 degrees, or more than what turns the view of a
// point at the median distance by 10 degrees.
struct UnobservableDirection {
  bool is_sensor = false;  // else a frame
  int idx = 0;
  bool is_rotation = false;
  Eigen::Vector3d direction = Eigen::Vector3d::Zero();  // in the axes above
};

struct CovarianceResult {
  // False if the equations could not be solved; then there is nothing else.
  bool is_usable = false;
  double sigma_px = 0.0;
  std::optional<int> fixed_frame_idx;  // absent where positions are measured
  bool scale_is_fixed = false;         // arbitrary unit
  // Per frame and sensor of the scene; nullopt without observations.
  std::vector<std::optional<PoseMatrix>> frames;
  std::vector<std::optional<PoseMatrix>> sensors;
  std::vector<UnobservableDirection> unobservable;
};

// `options` and `priors` are those the model was adjusted with. Cost: one
// linearisation and factorisation, and six solves for each pose.
[[nodiscard]] CovarianceResult ComputeCovariances(
    const Scene& scene, const Reconstruction& reconstruction,
    const BundleAdjustmentOptions& options, const Context& context,
    const BundlePriors& priors = {});

// Standard deviations of intrinsics in the same sense, per camera of the scene
// and parameter: zero where it is held. Empty for cameras without observations;
// nullopt if the equations could not be solved. Cost: one linearisation and
// factorisation.
[[nodiscard]] std::optional<std::vector<std::vector<double>>>
ComputeIntrinsicSigmas(const Scene& scene, const Reconstruction& reconstruction,
                       const BundleAdjustmentOptions& options,
                       const Context& context, const BundlePriors& priors = {});

}  // namespace mgsfm

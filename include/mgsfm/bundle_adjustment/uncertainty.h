// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <Eigen/Core>
#include <optional>
#include <string>
#include <vector>

#include "mgsfm/base/context.h"
#include "mgsfm/base/fields.h"
#include "mgsfm/bundle_adjustment/bundle_adjustment.h"
#include "mgsfm/geometry/rigid3.h"
#include "mgsfm/scene/estimates.h"
#include "mgsfm/scene/scene.h"

namespace mgsfm {

// Covariances of the poses of an adjusted model from the noise of its
// observations: sigma^2 (J^T W J)^-1 for the objective (1) of
// bundle_adjustment.h at the model. sigma is the noise of the keypoints as
// bundle adjustment estimates it; priors keep their own standard deviations.
// Constant poses and intrinsics count as exact. Gravity terms are ignored.
//
// The six coordinates of a pose are a rotation (radians, R <- Exp(w) R) and a
// translation. Sensors: both in the camera frame (S, t). Frames: the rotation
// in the rig frame, the translation of the center in the world frame.
//
// Gauge: that of bundle adjustment. Covariances of frames are relative to the
// fixed frame. If the unit of length is arbitrary, they are also relative to
// the coordinate that fixes scale.

// A direction in which the pose of a sensor or frame is undetermined. The
// standard deviation of a rotation exceeds 10 degrees; that of a translation
// exceeds the displacement that shifts the view of a point at the median
// distance by 10 degrees.
struct UnobservableDirection {
  bool is_sensor = false;  // otherwise a frame
  int idx = 0;
  bool is_rotation = false;
  Eigen::Vector3d direction = Eigen::Vector3d::Zero();  // in the frames above
};

struct CovarianceResult {
  // False if the equations cannot be solved; the other members are then unset.
  bool is_usable = false;
  double sigma_px = 0.0;
  std::optional<int> fixed_frame_idx;  // nullopt with position priors
  bool scale_is_fixed = false;         // the unit of length is arbitrary
  // Per frame and sensor of the scene; nullopt without observations.
  std::vector<std::optional<PoseMatrix>> frames;
  std::vector<std::optional<PoseMatrix>> sensors;
  std::vector<UnobservableDirection> unobservable;

  auto Fields() const {
    return Named("is_usable", is_usable, "sigma_px", sigma_px, "fixed_frame",
                 As<Item::kFrameName>(fixed_frame_idx), "scale_is_fixed",
                 scale_is_fixed);
  }
};

// `options` and `priors` are those of the adjustment of the model. Cost: one
// linearization and factorization, and six triangular solves per pose.
[[nodiscard]] CovarianceResult ComputeCovariances(
    const Scene& scene, const Reconstruction& reconstruction,
    const BundleAdjustmentOptions& options, const Context& context,
    const BundlePriors& priors = {});

// Lists the unobservable directions again after covariances have changed.
void ListUnobservable(const Scene& scene, const Reconstruction& reconstruction,
                      const Context& context, CovarianceResult* covariances);

// Standard deviations of intrinsics, per camera of the scene and parameter: 0
// for constant parameters, empty for cameras without observations. nullopt if
// the equations cannot be solved. Residuals that are correlated between nearby
// pixels, such as errors of the lens model, have less weight
// (src/estimation/bundle_adjustment/residual_field.h). Cost: one linearization
// and factorization.
[[nodiscard]] std::optional<std::vector<std::vector<double>>>
ComputeIntrinsicSigmas(const Scene& scene, const Reconstruction& reconstruction,
                       const BundleAdjustmentOptions& options,
                       const Context& context, const BundlePriors& priors = {});

// A refined focal length of an adjusted model. The message is empty unless one
// of these holds:
// - Unobservable: its relative standard deviation exceeds
//   max_focal_length_sigma. On a straight drive, for example, depth and focal
//   length are ambiguous.
// - Implausible: its ratio to the larger image side is outside
//   [min_focal_length_ratio, max_focal_length_ratio], it changed by more than a
//   factor of two, or a refined distortion parameter exceeds max_extra_param.
//
// The standard deviation is that of ComputeIntrinsicSigmas(), with the term of
// focal_length_start_sigma.
struct FocalLengthCheck {
  int camera_idx = 0;
  // Before and after refinement; the first of two focal lengths.
  double prior_px = 0.0;
  double estimated_px = 0.0;
  // The larger of the values of both focal lengths; nullopt if it cannot be
  // computed.
  std::optional<double> relative_sigma;
  std::string message;
};

// Whether this is the default focal length of feature extraction without EXIF:
// 1.2 times the larger image side, as in COLMAP.
[[nodiscard]] bool IsAssumedFocalLength(const Camera& camera,
                                        double focal_length_px);

// Checks each camera with observations whose focal length is refined. `scene`
// has the values before refinement; `options` and `priors` are those of the
// adjustment. Computes nothing if no focal length is refined.
[[nodiscard]] std::vector<FocalLengthCheck> CheckFocalLengths(
    const Scene& scene, const Reconstruction& model,
    const BundleAdjustmentOptions& options, const Context& context,
    const BundlePriors& priors = {});

}  // namespace mgsfm

// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <optional>
#include <string>
#include <vector>

#include "mgsfm/base/context.h"
#include "mgsfm/bundle/bundle_adjustment.h"
#include "mgsfm/scene/estimates.h"
#include "mgsfm/scene/scene.h"

namespace mgsfm {

// A refined focal length of an adjusted model. The message is empty unless one
// of these holds:
// - Unobservable: its relative standard deviation (covariance.h) exceeds
//   max_focal_length_sigma. On a straight drive, for example, depth and focal
//   length are ambiguous.
// - Implausible: its ratio to the larger image side is outside
//   [min_focal_length_ratio, max_focal_length_ratio], it changed by more than a
//   factor of two, or a refined distortion parameter exceeds max_extra_param.
//
// The standard deviation covers the noise of keypoints and the term of
// focal_length_start_sigma, but not errors of the camera model.
struct FocalLengthCheck {
  int camera_idx = 0;
  // Before and after refinement; the first of two focal lengths.
  double prior_px = 0.0;
  double estimated_px = 0.0;
  // The largest of both focal lengths; nullopt if it cannot be computed.
  std::optional<double> relative_sigma;
  std::string message;
};

// Checks each camera with observations whose focal length is refined. `scene`
// has the values before refinement; `options` and `priors` are those of the
// adjustment. Computes nothing if no focal length is refined.
[[nodiscard]] std::vector<FocalLengthCheck> CheckFocalLengths(
    const Scene& scene, const Reconstruction& model,
    const BundleAdjustmentOptions& options, const Context& context,
    const BundlePriors& priors = {});

}  // namespace mgsfm

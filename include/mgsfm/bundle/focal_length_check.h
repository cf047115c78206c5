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

// A refined focal length, of an adjusted model. The message says what is wrong
// with it, if anything is:
// - its relative standard deviation (covariance.h) is above
//   max_focal_length_sigma: driving straight ahead, for one, changes images in
//   much the same way whatever the focal length is;
// - compared with the larger side of the image it is out of
//   min_focal_length_ratio to max_focal_length_ratio, or it changed by more
//   than a factor of two, or a distortion parameter that was refined along is
//   beyond max_extra_param.
// The standard deviation is that by the noise of keypoints, and by what
// focal_length_start_sigma adds: errors of a model of the lens are more.
struct FocalLengthCheck {
  int camera_idx = 0;
  double prior_px = 0.0;                 // the first, if there are two
  double estimated_px = 0.0;             // likewise
  std::optional<double> relative_sigma;  // the largest; nullopt: not known
  std::string message;
};

// One for each camera with observations whose focal length is refined; nothing
// is computed if there are none. `scene` has the values that refinement
// started from; `options` and `priors` are those of the adjustment.
[[nodiscard]] std::vector<FocalLengthCheck> CheckFocalLengths(
    const Scene& scene, const Reconstruction& model,
    const BundleAdjustmentOptions& options, const Context& context,
    const BundlePriors& priors = {});

}  // namespace mgsfm

// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <optional>

#include "mgsfm/scene/estimates.h"
#include "mgsfm/scene/priors.h"
#include "mgsfm/scene/scene.h"

namespace mgsfm {

// How far the clock of measured positions is ahead of that of the images.
struct ClockOffset {
  double offset_s = 0.0;
  double sigma_s = 0.0;
  double speed = 0.0;  // root mean square, in units of the world per second
  // Larger by chance in 1 of 10,000 recordings.
  bool is_significant = false;
};

// Estimates the offset from a model that is registered to the positions but not
// yet adjusted to them:
//
//   min sum_i rho(|g_i - c_i - a - w x d_i - s d_i + v_i o|^2 / sigma_i^2)
//
// over the offset o and a small similarity (a, w, s), for images with a time, a
// position g_i, a center c_i at d_i from the mean center, and a velocity v_i by
// central differences of the centers. s is 0 if the model is metric. rho is
// Huber's; images beyond OutlierBound of the current fit do not count, so that
// a large offset does not look like outliers. A clock that is ahead assigns to
// an image where the rig was before.
//
// The standard deviation is the larger one of noise (sigma_i) and of a
// jackknife over 16 stretches of time, which knows the drift of the model. An
// antenna ahead of the camera by v o looks the same at constant speed. nullopt
// without enough images, or if the motion does not tell: a straight path at
// constant speed is shifted by the offset as a whole.
std::optional<ClockOffset> EstimateClockOffset(
    const Scene& scene, const PositionPriors& priors,
    const Reconstruction& reconstruction, bool is_metric);

}  // namespace mgsfm

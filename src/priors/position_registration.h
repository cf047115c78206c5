// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <Eigen/Core>
#include <cstdint>
#include <optional>

#include "mgsfm/scene/estimates.h"
#include "mgsfm/scene/priors.h"
#include "mgsfm/scene/scene.h"

namespace mgsfm {

// Registers a model to measured positions by a similarity, and selects the
// positions that bundle adjustment uses.
//
//   min sum_i |s R c_i + t - g_i|^2 / sigma_i^2 + |R d - z|^2 / sigma_up^2
//
// over images with a centre c_i in the model and a position g_i. sigma_i^2 is a
// third of the trace of its covariance. s is 1 if the model is metric.
//
// The last term matters only if the positions are collinear. z is up. d is the
// upward direction of measured gravity (sigma_up 1 degree), or the mean upward
// axis of the reference cameras (sigma_up 10 degrees). The term applies only if
// the world has an origin on the earth; otherwise the rotation is arbitrary.
//
// Method: least median of |residual| / sigma over 500 fits to three images.
// Then fits to all images within max(4, 3 medians), at most 10 or until this
// set does not change. The others are outliers. O(images) per fit.
//
// The model stays unchanged, and the message says why, if fewer than three
// images have positions or if the extent of the positions is less than 3
// standard deviations.
struct PositionRegistration {
  PositionPriorSummary summary;
  PositionPriors used;  // empty if the model is unchanged
};
PositionRegistration RegisterToPriors(const Scene& scene,
                                      const PositionPriors& priors,
                                      const std::optional<Eigen::Vector3d>& up,
                                      bool is_metric, uint64_t random_seed,
                                      Reconstruction* reconstruction);

// The distance in standard deviations beyond which positions are outliers, from
// the median of all distances.
double OutlierBound(double median_distance);

// Adds the distances of the final model from the positions, and the outliers,
// to the summary.
void EvaluatePositions(const Scene& scene, const PositionPriors& priors,
                       const PositionPriors& used,
                       const Reconstruction& reconstruction,
                       PositionPriorSummary* summary);

}  // namespace mgsfm

// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <Eigen/Core>
#include <cstdint>
#include <optional>

#include "mgsfm/priors/prior_summaries.h"
#include "mgsfm/scene/estimates.h"
#include "mgsfm/scene/position_priors.h"
#include "mgsfm/scene/scene.h"

namespace mgsfm {

// Moves a model into the world of measured positions by the similarity that
// fits them, and chooses those that bundle adjustment is to use:
//
//   min sum_i |s R c_i + t - g_i|^2 / sigma_i^2 + |R d - z|^2 / sigma_up^2
//
// over images with a centre c_i in the model and a position g_i, sigma_i^2 a
// third of the trace of its covariance; s is 1 if the model is metric already.
// The last term only has a say where positions are on a line: z is up, d is the
// upward direction by measured gravity, sigma_up 1 degree; without gravity the
// mean upward axis of the reference cameras, sigma_up 10 degrees. Without an
// origin on the earth it is left out, and such a turn is arbitrary.
//
// The start is the best of 500 fits to three images by the median of
// |residual| / sigma. Then fits to all images within max(4, 3 medians) follow,
// until these do not change or ten times; those beyond are outliers, which are
// not used. O(images) each.
//
// The model stays as it is, and message says why, if fewer than three images
// have positions or these differ by no more than three times their error.
struct PositionRegistration {
  PositionPriorSummary summary;
  PositionPriors used;  // empty if the model stays
};
PositionRegistration RegisterToPriors(const Scene& scene,
                                      const PositionPriors& priors,
                                      const std::optional<Eigen::Vector3d>& up,
                                      bool is_metric, uint64_t random_seed,
                                      Reconstruction* reconstruction);

// Positions that are more standard deviations off are outliers, given the
// median of all.
double OutlierBound(double median_distance);

// Adds how far the final model is from the positions, and which it contradicts.
void JudgePriors(const Scene& scene, const PositionPriors& priors,
                 const PositionPriors& used,
                 const Reconstruction& reconstruction,
                 PositionPriorSummary* summary);

}  // namespace mgsfm

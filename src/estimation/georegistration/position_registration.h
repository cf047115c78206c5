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
//   min sum_i |R (s c_i + l_i) + t - g_i|^2 / sigma_i^2
//       + |R d - z|^2 / sigma_up^2
//
// over images with a center c_i in the model and a position g_i of the antenna,
// which the lever l_i, in the axes of the model and the unit of g_i, connects
// with the center. sigma_i^2 is a third of the trace of the covariance of g_i.
// s is 1 if the model is metric.
//
// The last term matters only if the positions are collinear. z is up. d is the
// upward direction of measured gravity (sigma_up 1 degree), or the mean upward
// axis of the reference cameras (sigma_up 10 degrees). The term applies only if
// the world has an origin on the earth; otherwise, the rotation about the line
// is arbitrary.
//
// Method: the best of 500 fits to three images, then at most 10 fits to all
// images whose |residual| / sigma is within a bound, until this set does not
// change. All other images are outliers. OutlierRule defines the best fit and
// the bound. O(images) per fit.
//
// The model stays unchanged, and the message says why, if fewer than three
// images have positions or if the extent of the positions is less than 3
// standard deviations.
enum class OutlierRule {
  // Least median; the bound is max(4, 3 medians). Up to 50 % outliers.
  kLeastMedian,
  // Most images within the bound 4 (RANSAC). Three of four images may be
  // outliers: the probability that none of 500 samples is free of outliers is
  // 4e-4.
  kFixedBound,
  // No outliers: the least-squares fit to all images.
  kNone,
};

struct PositionRegistration {
  PositionPriorSummary summary;
  PositionPriors used;  // empty if the model is unchanged
};
struct RegistrationOptions {
  std::optional<Eigen::Vector3d> up = std::nullopt;  // in the model
  bool is_metric = false;
  uint64_t random_seed = 0;
  OutlierRule outlier_rule = OutlierRule::kLeastMedian;
};
PositionRegistration RegisterToPriors(const Scene& scene,
                                      const PositionPriors& priors,
                                      const RegistrationOptions& options,
                                      Reconstruction* reconstruction);

// The distance, in standard deviations, beyond which positions are outliers;
// derived from the median distance.
double OutlierBound(double median_distance);

// Adds the distances between final model and positions, and the outliers, to
// the summary.
void EvaluatePositions(const Scene& scene, const PositionPriors& priors,
                       const PositionPriors& used,
                       const Reconstruction& reconstruction,
                       PositionPriorSummary* summary);

}  // namespace mgsfm

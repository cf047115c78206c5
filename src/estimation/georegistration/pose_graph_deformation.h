// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <optional>

#include "mgsfm/base/context.h"
#include "mgsfm/base/mask.h"
#include "mgsfm/scene/estimates.h"
#include "mgsfm/scene/priors.h"
#include "mgsfm/scene/scene.h"
#include "mgsfm/scene/view_graph.h"

namespace mgsfm {

// Pose-graph deformation of a model to measured positions. One similarity
// (position_registration.h) cannot undo drift, and bundle adjustment would
// treat the remaining distances as outliers.
//
// Unknowns. Each frame f has a center c'_f, a rotation Q_f and a scale e^s_f,
// and moves its surroundings by x -> c'_f + e^s_f Q_f (x - c_f).
//
// Objective, with D = c_g - c_f between the centers of two frames that an image
// pair connects, and the position g_i with covariance C_i of a point of image
// i, which the deformation moves to p'_i:
//
//   min  sum_fg [ |c'_g - c'_f - (e^s_f Q_f + e^s_g Q_g) D / 2|^2 / |D|^2
//                 + |Log(Q_f^T Q_g)|^2 + (s_g - s_f)^2 ] / sigma^2
//      + sum_i rho((p'_i - g_i)^T C_i^-1 (p'_i - g_i))
//
// - |D| is at least a tenth of the median.
// - s = 0 if the model is metric or a rig has cameras at different centers,
//   because then scale does not drift.
// - rho is Cauchy with scale max(2.8, 2 medians) of the distances in standard
//   deviations, updated in each step. A fixed scale would treat a segment that
//   has drifted as outliers.
// - sigma, the drift of an edge in radians, goes through 0.01, 0.04, 0.16 and
//   0.64 degrees, so the result is as stiff as the positions allow.
//
// Gauge: determined by the positions, otherwise by a damping of 1e-9.
//
// Stopping criteria. A model stays bitwise unchanged if the 75 % quantile of
// the distances is at most 3 standard deviations. Otherwise, sigma grows until
// this holds and the last increase has not brought more positions within max(4,
// 3 medians). At most 8 Gauss-Newton steps per sigma; they end when no frame
// moves by more than 1e-3 standard deviations.
//
// Cost of a step: one sparse Cholesky factorization of 7 unknowns per frame.
//
// Points move by the mean over the frames that observe them. Positions finally
// within max(4, 3 medians) are added to `used`. Returns nullopt and changes
// nothing if no deformation is needed or none improves the model.
struct DeformationInput {
  const Scene& scene;
  const ViewGraph& view_graph;
  const Mask& pair_is_used;
  const PositionPriors& priors;
  bool is_metric = false;
};
std::optional<ModelDeformation> DeformToPriors(const DeformationInput& input,
                                               const Context& context,
                                               PositionPriors* used,
                                               Reconstruction* reconstruction);

}  // namespace mgsfm

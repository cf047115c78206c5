// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <Eigen/Core>
#include <vector>

#include "mgsfm/base/context.h"
#include "mgsfm/base/mask.h"
#include "mgsfm/scene/scene.h"
#include "mgsfm/scene/view_graph.h"
#include "translation/position_problem.h"

namespace mgsfm {

enum class BaselineKind {
  kUnused,      // not used before, or no motion explains its matches
  kNoParallax,  // the matches agree with a rotation alone
  kDirection,   // the direction of the baseline is known
};

// Depth of a keypoint's point along its ray, in baselines of the pair.
struct DepthSample {
  int keypoint_idx;
  float log_depth;
};

struct BaselineDirection {
  int image_idx1 = 0;
  int image_idx2 = 0;
  BaselineKind kind = BaselineKind::kUnused;
  // Unit, in the world, from the centre of camera 1 to that of camera 2, and
  // its standard deviation. Only of kDirection.
  Eigen::Vector3d direction = Eigen::Vector3d::Zero();
  double sigma_rad = 0.0;
  // For cameras 1 and 2, of the matches with parallax, by keypoint.
  std::vector<DepthSample> depths[2];
};

// The direction b of the baseline between two cameras whose rotations are
// known:
//
//   min_b sum_m rho((b . n_m)^2 / (|b x g1_m|^2 + |b x g2_m|^2)),
//   n_m = g1_m x g2_m,  |b| = 1,
//
// over rays g in world axes. A term is the epipolar residual of a match in
// units of the angular noise of a ray (Sampson), so neither the parallax
// |n_m| = sin(parallax) nor the distance to the epipole biases the result; n_m
// alone would pull b towards the viewing direction. Solved by reweighting the
// generalised eigenproblem M b = lambda N b (Taubin) from the best of sampled
// two-match solutions, Geman-McClure with three robust standard deviations.
// Sign: points in front of both cameras.
std::vector<BaselineDirection> EstimateBaselineDirections(
    const Scene& scene, const Bearings& bearings, const ViewGraph& view_graph,
    const Mask& pair_is_used, const PositionProblem& problem,
    double min_parallax_deg, const Context& context);

}  // namespace mgsfm

// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <Eigen/Core>
#include <array>
#include <vector>

#include "mgsfm/base/context.h"
#include "mgsfm/base/mask.h"
#include "mgsfm/scene/scene.h"
#include "mgsfm/scene/view_graph.h"
#include "translation_averaging/position_problem.h"

namespace mgsfm {

enum class BaselineKind {
  kUnused,      // not measured, or no direction explains the matches
  kNoParallax,  // the matches agree with a rotation alone
  kDirection,   // the direction of the baseline is known
};

// Depth of a keypoint's point along its ray, in baselines of the pair.
struct DepthSample {
  int keypoint_idx;
  float log_depth;
};

// Sorts by keypoint, then by depth.
void SortByKeypoint(std::vector<DepthSample>* depths);

// The measured direction of the baseline of one image pair.
struct BaselineDirection {
  int image_idx1 = 0;
  int image_idx2 = 0;
  BaselineKind kind = BaselineKind::kUnused;
  // Unit vector in the world from the center of camera 1 to the center of
  // camera 2, and its standard deviation. Defined for kDirection only.
  Eigen::Vector3d direction = Eigen::Vector3d::Zero();
  double sigma_rad = 0.0;
  // Depths in camera 1 and camera 2 of the matches with parallax, sorted by
  // keypoint.
  std::array<std::vector<DepthSample>, 2> depths;
};

// Estimates the direction b of the baseline between two cameras with known
// rotations:
//
//   min_b sum_m rho((b . n_m)^2 / (|b x g1_m|^2 + |b x g2_m|^2)),
//   n_m = g1_m x g2_m,  |b| = 1,
//
// over the rays g of the matches in world axes. A term is the epipolar residual
// of a match in units of the angular noise of a ray (Sampson). Neither the
// parallax |n_m| nor the distance to the epipole biases the result; residuals b
// . n_m would pull b toward the viewing direction.
//
// Solver: the best of sampled two-match solutions, then reweighting of the
// generalized eigenproblem M b = lambda N b (Taubin 1991) with a Geman-McClure
// loss of three robust standard deviations, until b changes by less than 1e-6
// or for 20 iterations. Sign: points lie in front of both cameras.
//
// A pair is kNoParallax if its relative pose has no direction, or if no
// direction is found and at most 40 % of its matches have parallax. Matches
// with less than min_parallax_deg of parallax have no depths.
// A pair with a relative pose and without matches is kDirection with the
// direction of that pose and without depths.
// Result: one item per pair of the view graph. Pairs outside pair_is_used and
// pairs of images without rotation are kUnused.
// Cost: linear in the matches; parallel over pairs.
//
// With PairRotation::kOwn the two-view rotation of the pair replaces the
// averaged one. The baseline then does not depend on whether the pair agrees
// with others, but uses the averaged rotation of camera 2 for its axes.
enum class PairRotation { kAveraged, kOwn };
struct BaselineInput {
  const Scene& scene;
  const Bearings& bearings;
  const ViewGraph& view_graph;
  const Mask& pair_is_used;
  const PositionProblem& problem;
};
std::vector<BaselineDirection> EstimateBaselineDirections(
    const BaselineInput& input, double min_parallax_deg, const Context& context,
    PairRotation rotation = PairRotation::kAveraged);

}  // namespace mgsfm

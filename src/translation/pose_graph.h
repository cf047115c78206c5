// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <Eigen/Geometry>
#include <optional>
#include <vector>

#include "mgsfm/base/context.h"
#include "mgsfm/base/solver.h"
#include "mgsfm/scene/estimates.h"
#include "mgsfm/scene/view_graph.h"
#include "translation/refinement_terms.h"

namespace mgsfm {

// Joint refinement of the rotations and positions of frames by relative poses.
//
// Rotation averaging does not know the positions, and positions are estimated
// with rotations held. If the rotations drift, the positions cannot close a
// loop without bending every step, which costs more than to tear the one that
// the fewest pairs cross. With both free, a small turn of each step closes it.
//
// Unknowns: the rotation R_f and the centre c_f of each frame. A used pair of
// frames f, g with a direction has the cameras R_1 = S_1 R_f, R_2 = S_2 R_g,
// the baseline d = R_1 (C_2 - C_1) in camera 1, and the measured R_12,
// direction b and length l:
//
//   min  sum rho(|2 v|^2 / sigma_R^2
//              + |N (d - l b)|^2 / sigma_N^2 + (b . (d - l b))^2 / sigma_l^2)
//
// - v is the vector part of the quaternion of R_12^T R_2 R_1^T; 2 v is its
//   rotation vector for small errors.
// - N projects to the plane across b. sigma_N and sigma_l are l times the
//   standard deviations of direction and log-length, at least 0.001 of the
//   typical depth of points.
// - rho is Cauchy with scale 3, annealed from 24 (kLossAnnealing).
// - Sensor poses are held: one tear does not show in them.
//
// Start: the rotations that the measurements used, and the L1 positions.
// Gauge: the first frame is held, the lengths determine the scale.
// Solver: Ceres, until the cost changes by less than 1e-6, or 50 iterations,
// for each scale of rho. Cost of an iteration: linear in the pairs, and a
// sparse Cholesky factorisation with six unknowns per frame.
struct PoseGraphEstimate {
  // Per frame; nullopt where the start is.
  std::vector<std::optional<Eigen::Quaterniond>> rig_from_world;
  SolveSummary summary;  // of the last scale of rho
};

// Returns the start if Ceres finds no usable solution. Throws Interrupted.
[[nodiscard]] PoseGraphEstimate RefinePoseGraph(
    const RefinementInput& input, const ViewGraph& view_graph,
    const RotationEstimate& rotations, const Context& context);

}  // namespace mgsfm

// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <Eigen/Geometry>
#include <optional>
#include <vector>

#include "mgsfm/base/context.h"
#include "mgsfm/base/solver.h"
#include "mgsfm/scene/estimates.h"
#include "mgsfm/scene/view_graph.h"
#include "translation_averaging/translation_stages.h"

namespace mgsfm {

// Joint refinement of the rotations and positions of frames by relative poses.
//
// Rotation averaging ignores positions, and positions are estimated with
// constant rotations. If the rotations drift, the positions can close a loop
// only by bending every step, which costs more than tearing the step that the
// fewest pairs cross. With both free, a small rotation of each step closes the
// loop.
//
// Unknowns: the rotation R_f and the center c_f of each frame that a used pair
// connects with another placed frame. A pair of frames f, g has the cameras
// R_1 = S_1 R_f, R_2 = S_2 R_g, the baseline d = R_1 (C_2 - C_1) in camera 1,
// and the measured R_12, direction b and length l:
//
//   min  sum rho(|2 v|^2 / sigma_R^2
//              + |N (d - l b)|^2 / sigma_N^2 + (b . (d - l b))^2 / sigma_l^2)
//
// - v is the vector part of the quaternion of R_12^T R_2 R_1^T; 2 v is its
//   rotation vector for small errors.
// - N projects onto the plane normal to b, which was measured with the initial
//   rotations. sigma_N and sigma_l are l times the standard deviations of
//   direction and log-length, increased by 0.001 of the typical depth of
//   points.
// - Pairs without parallax have l = 0 and a standard deviation of 0.016 typical
//   depths. The lengths of all but the largest scale group do not count.
// - rho is Cauchy with scale 3, annealed from 24 (kLossAnnealing).
// - Sensor poses are constant: a single tear hardly affects them. Gravity is
//   not used.
//
// Start: the rotations that the measurements used, and the L1 positions. Gauge:
// the first frame is constant; the lengths determine the scale. Solver: Ceres
// on one thread, for each scale of rho until the relative decrease of the cost
// is below 1e-6 (or another default criterion of Ceres holds), at most 50
// iterations. Cost of an iteration: linear in the pairs, and a sparse Cholesky
// factorization with six unknowns per frame.
//
// Other frames rotate like the previous solved frame.
struct PoseGraphEstimate {
  // Per frame; nullopt where the initial rotation is.
  std::vector<std::optional<Eigen::Quaterniond>> rig_from_world;
  SolveSummary summary;  // of the last scale of rho
};

// Returns the start if Ceres finds no usable solution. Throws Interrupted.
[[nodiscard]] PoseGraphEstimate RefinePoseGraph(
    const RefinementInput& input, const ViewGraph& view_graph,
    const RotationEstimate& rotations, const Context& context);

}  // namespace mgsfm

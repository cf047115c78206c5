// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <Eigen/Core>
#include <string>
#include <vector>

#include "mgsfm/base/context.h"
#include "mgsfm/base/summary.h"
#include "translation/position_problem.h"
#include "translation/relative_translation.h"
#include "translation/scale_averaging.h"

namespace mgsfm {

// Convex initialisation of all positions. With C_p the baseline of pair p, that
// is c_j - c_i of its images, b_p its measured direction and s_p = a_g scale_p
// its length (a_g the factor of its group of scales), it minimises
//
//   sum_p  [ |(I - b b^T) C| / sigma_p + phi(b . C - s) ] / length_p
// + sum_q  |C_q| / sigma_0                          (pairs without parallax)
// + sum_g  n_g |a_g - 1| / sigma_g                  (groups but the first)
//
//   phi(v) = |v| min(0.15 / sigma_s,p, 1) / sigma_p for b . C >= scale_p / 10,
//   continued with slope 1 / sigma_p below,
//
//   length_p = max(scale_p, min(q_i, q_j) / 2), q the lower quartile of scale_p
//   of all pairs of a frame with other frames; scale_p of pairs in a frame,
//
// over the frame centres, the internal translations of free sensors, and the
// factors a_g. It is eq. (11) of MGSfM, min |s b - C| with s bounded from
// below, with the unknown s eliminated pair by pair, norms that do not depend
// on the axes, and measured lengths and bounds instead of the same bound 1 for
// all.
//
// Gauge: the first placed frame is at the origin, a_0 = 1. With given internal
// translations, their length in the unit of a_0 is one more unknown; the result
// is in the unit they are given in.
//
// Directions of internal translations whose standard deviation exceeds half of
// the unit are not determined; they are set to zero and reported.
//
// Solved by the ADMM of mgsfm/math/l1_admm.h, which has the stopping rules.
struct InitialPositions {
  Positions positions;
  SolveSummary solve;
  // Length that scale_p = 1 has in each group.
  std::vector<double> group_factor;
  // Orthonormal rows over the stacked translations of free sensors (3 each, in
  // the order of free_sensors) that are not determined.
  std::vector<int> free_sensors;
  Eigen::MatrixXd unobservable;
  // Given internal translations tell the unit of length.
  bool is_metric = false;
};

// When the ADMM ends.
struct InitializationOptions {
  int max_num_iterations = 2000;
  double relative_tolerance = 1e-4;
};

InitialPositions InitializePositions(
    const PositionProblem& problem,
    const std::vector<BaselineDirection>& motions, const PairScales& scales,
    double min_parallax_deg, const InitializationOptions& options = {},
    const Context& context = {});

// The prox of phi at v with step 1 / rho, where phi(v) = |v| for v >= bound and
// rises with slope `steep` >= 1 below bound <= 0.
double ProxOfScaleResidual(double v, double rho, double bound, double steep);

}  // namespace mgsfm

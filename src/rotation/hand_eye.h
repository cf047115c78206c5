// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <Eigen/Core>
#include <Eigen/Geometry>
#include <vector>

#include "mgsfm/base/summary.h"

namespace mgsfm {

// The same motion as two sensors on one rig saw it, as angle-axis vectors: with
// X = a_from_b it is alpha = X beta, since Exp(alpha) = X Exp(beta) X^T.
struct MotionPair {
  Eigen::Vector3d alpha;
  Eigen::Vector3d beta;
};

struct HandEyeResult {
  Eigen::Quaterniond a_from_b = Eigen::Quaterniond::Identity();
  double median_error_rad = 0.0;  // of |alpha - X beta|
  // Root mean square of the turns about the second of three principal axes: X
  // is determined only if it is well above zero (Park, Martin 1994).
  double second_axis_rms_rad = 0.0;
  // Standard deviation of X about its least certain axis, from the two above.
  double uncertainty_rad = 0.0;
  SolveSummary summary;
};

// Hand-eye calibration of rotations: argmin_X sum_i rho(|alpha_i - X beta_i|^2)
// over X in SO(3), rho Geman-McClure with its scale lowered from 5 deg to six
// robust standard deviations, each step in closed form (Wahba's problem by
// SVD). Stops when X changes by at most 1e-9 rad at the final scale
// (converged), or after 100 iterations. `num_independent` of the motions count
// for the uncertainty. Motions must not be empty.
HandEyeResult CalibrateHandEye(const std::vector<MotionPair>& motions,
                               int num_independent);

}  // namespace mgsfm

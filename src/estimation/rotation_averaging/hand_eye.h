// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <Eigen/Core>
#include <Eigen/Geometry>
#include <vector>

#include "mgsfm/base/solver.h"

namespace mgsfm {

// One motion of a rig, measured by its sensors a and b as angle-axis vectors:
// alpha = X beta with X = a_from_b, because Exp(alpha) = X Exp(beta) X^T.
struct MotionPair {
  Eigen::Vector3d alpha;
  Eigen::Vector3d beta;
};

struct HandEyeResult {
  Eigen::Quaterniond a_from_b = Eigen::Quaterniond::Identity();
  double median_error_rad = 0.0;  // of |alpha - X beta|
  // Root mean square of the rotations about the second of three principal axes.
  // X is determined only if this value is well above zero (Park, Martin 1994).
  double second_axis_rms_rad = 0.0;
  // Standard deviation of X about its least certain axis, from the two values
  // above.
  double uncertainty_rad = 0.0;
  SolveSummary summary;
};

// Hand-eye calibration of rotations: argmin_X sum_i rho(|alpha_i - X beta_i|^2)
// over X in SO(3). rho is the loss of Geman and McClure, annealed as in
// rotation_solver.h; each step has a closed form (Wahba's problem by SVD).
// Stops when X changes by at most 1e-9 rad at the final scale (converged), or
// after 100 iterations. The uncertainty counts `num_independent` of the
// motions, which must not be empty.
HandEyeResult CalibrateHandEye(const std::vector<MotionPair>& motions,
                               int num_independent);

}  // namespace mgsfm

// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <vector>

#include "geometry/so3.h"
#include "math/robust_loss.h"
#include "math/robust_scale.h"
#include "mgsfm/base/context.h"
#include "mgsfm/base/solver.h"
#include "mgsfm/rotation_averaging/rotation_averaging.h"
#include "rotation_averaging/rotation_equations.h"
#include "rotation_averaging/rotation_initialization.h"
#include "rotation_averaging/rotation_problem.h"

namespace mgsfm {

// Weights of gravity terms relative to edges. A term has the weight (sigma_e /
// sigma_g)^2 rho'. sigma_g is the standard deviation of the priors per axis:
// gravity_sigma_rad, or the robust estimate from the residuals if larger.
// sigma_e is the standard deviation of edges of weight 1, at least sigma_g /
// 10. rho is the loss of Geman and McClure; its scale starts at 20 deg, or 6
//     sigma_g if larger, and is multiplied by 0.7 in each step down to 3
//     sigma_g. Scale and sigmas are final once 3 sigma_g is reached and the
//     scale of the edges is final.
class GravityWeighting {
 public:
  explicit GravityWeighting(const RotationProblem& problem)
      : problem_(problem), is_final_(problem.gravity.empty()) {}

  // Residuals and weights for the next step. `edge_norms`: the residual norms
  // of all edges (radians).
  const GravityValues& Next(const RotationState& state,
                            const std::vector<double>& edge_norms,
                            bool edges_are_final);
  bool IsFinal() const { return is_final_; }

 private:
  void AdjustScale(const std::vector<double>& angles,
                   const std::vector<double>& edge_norms, bool edges_are_final);

  const RotationProblem& problem_;
  bool is_final_;
  AnnealedScale scale_ = AnnealedScale(DegToRad(20.0), 0.7);
  double scale_rad_ = 0.0;
  double variance_ratio_ = 0.0;
  GravityValues values_;
};

// Rotates the world of each connected component with gravity terms such that
// the robust mean of their directions becomes y.
void LevelComponents(const RotationProblem& problem, RotationState* state);

// Annealing of the scale of a Geman-McClure loss (graduated non-convexity,
// Black and Rangarajan 1996). With sigma the robust standard deviation of the
// residuals at a step and target = max(6 sigma, 0.05 deg), the scale starts at
// max(5 deg, 2 target) and is multiplied by 0.7 in each step until it reaches
// the target; from then on it is final.
class RobustScaleSchedule {
 public:
  // The loss for the next iteration, given the residual norms (radians).
  RobustLoss Next(const std::vector<double>& norms);
  bool IsFinal() const { return is_final_; }
  double scale_rad() const { return scale_rad_; }

 private:
  AnnealedScale scale_ = AnnealedScale(DegToRad(5.0), 0.7);
  double scale_rad_ = 0.0;
  bool is_final_ = false;
};

// Minimizes sum w |e| over the nodes with fixed sensors (Chatterjee and
// Govindu, ICCV 2013): each step minimizes the linearized sum w |e + d_1 - d_2|
// by ADMM. Stops when the root mean square of a step is at most 0.05 deg, or
// after max_num_l1_iterations steps. The cost in the summary is the objective.
SolveSummary AverageL1(const RotationProblem& problem,
                       const RotationAveragingOptions& options,
                       const Context& context, RotationState* state);

// Minimizes sum w rho(|e|^2) / 2 over nodes and free sensors by re-weighted
// Gauss-Newton steps (rotation_equations.h), with gravity terms weighted by
// GravityWeighting. Stops when all rotations change by at most
// step_tolerance_deg at the final scale, or after max_num_iterations. Both
// costs in the summary are those of the edges at the final scale. After a
// failure, the state is the result of the last successful step.
SolveSummary AverageRobust(const RotationProblem& problem,
                           const RotationAveragingOptions& options,
                           const Context& context, RotationState* state);

// Initialization by a spanning forest (rotation_initialization.h), AverageL1()
// and AverageRobust(), whose summary is returned. If the L1 step fails,
// AverageRobust() continues from its last state. With a start, the L1 step is
// skipped: it converges to the majority from any start, while the robust step
// stays close.
SolveSummary AverageNodes(const RotationProblem& problem,
                          const NodeStart& start,
                          const RotationAveragingOptions& options,
                          const Context& context, RotationState* state);

}  // namespace mgsfm

// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <vector>

#include "geometry/so3.h"
#include "math/robust_scale.h"
#include "rotation_averaging/rotation_equations.h"
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

}  // namespace mgsfm

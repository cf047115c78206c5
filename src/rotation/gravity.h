// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <vector>

#include "geometry/so3.h"
#include "math/robust_scale.h"
#include "rotation/rotation_equations.h"
#include "rotation/rotation_problem.h"

namespace mgsfm {

// Weights of the terms of gravity among edges, from step to step: with sigma_g
// the given standard deviation, or median / 1.177 (of the length of a normal
// 2-vector) if that is more, and sigma_e that of the edges, at least a tenth of
// it, a term weighs (sigma_e / sigma_g)^2 rho'. rho: Geman-McClure; its
// scale begins at 20 degrees, or 6 sigma_g, and falls by 0.7 in each step down
// to 3 sigma_g. All is held once that is reached and edges have their final
// scale.
class GravityWeighting {
 public:
  explicit GravityWeighting(const RotationProblem& problem)
      : problem_(problem), is_final_(problem.gravity.empty()) {}

  // For the next step, given the norms of the residuals of all edges, radians.
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

// Turns the world of each connected part with terms of gravity such that the
// robust mean of these is y.
void LevelParts(const RotationProblem& problem, RotationState* state);

}  // namespace mgsfm

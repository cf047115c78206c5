// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <Eigen/Core>
#include <vector>

#include "mgsfm/base/context.h"
#include "mgsfm/base/summary.h"
#include "translation/refinement_terms.h"

namespace mgsfm {

// A residual of the refinements below, and its derivatives.
struct BilinearResidual {
  Eigen::Vector3d value;       // w (v - d C)
  double by_difference = 0.0;  // times the identity
  Eigen::Vector3d by_scale;
};

inline BilinearResidual EvaluateBilinear(const Eigen::Vector3d& direction,
                                         const Eigen::Vector3d& difference,
                                         double scale, double weight) {
  return {weight * (direction - scale * difference), -weight * scale,
          -weight * difference};
}

// The refinements of angle_refinement.h with bilinear residuals, to compare
// with (BATA, Zhuang et al. 2018; global positioning of GLOMAP; eqs. (14), (15)
// of MGSfM with its rig constraint (2)): every direction v of a difference C of
// positions gets a scale d as one more unknown,
//
//   rho(|w (v - d C)|),  d >= 1e-5,
//
// with C = p - c_i of points and C = c_j - c_i of pairs, c_i = c^g - R_i^T t^r.
// Known lengths s of pairs, which angles leave open on straight motion, are
// residuals w' (d s - 1) there, baselines without parallax w C.
// Weights, losses and annealing are those of the non-bilinear refinements.
//
// Unknowns: free frame centres, internal translations, points, and all d.
// Gauge: the first frame is constant; what was found to be undetermined is held
// by linear terms. The scale is free, steps are damped.
// Start: d = 1 / |C|; where positions start at random, d = 1.
//
// By Ceres: Levenberg-Marquardt on one thread, so that sums have a fixed order.
// Ends when the relative decrease of the cost is below function_tolerance. Cost
// of an iteration: linear in the observations, and a sparse Cholesky
// factorisation over all unknowns.
SolveSummary RefineCamerasBilinearly(const RefinementInput& input,
                                     const RefinementOptions& options,
                                     const Context& context,
                                     Positions* positions);
SolveSummary RefineCamerasAndPointsBilinearly(
    const RefinementInput& input, const TrackRays& rays,
    const std::vector<size_t>& track_idxs, const RefinementOptions& options,
    const Context& context, Positions* positions, TrackPoints* points);

constexpr PositionObjective kBilinearObjective = {
    RefineCamerasBilinearly, RefineCamerasAndPointsBilinearly};

}  // namespace mgsfm

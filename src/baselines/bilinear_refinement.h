// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <vector>

#include "mgsfm/base/context.h"
#include "mgsfm/base/summary.h"
#include "translation/refinement_terms.h"

namespace mgsfm {

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
// Levenberg-Marquardt with scales and points eliminated
// (mgsfm/least_squares/rig_solver.h); ends when the relative decrease of the
// cost is below function_tolerance.
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

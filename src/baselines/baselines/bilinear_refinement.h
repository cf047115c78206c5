// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <vector>

#include "mgsfm/base/context.h"
#include "mgsfm/base/solver.h"
#include "translation_averaging/translation_stages.h"

namespace mgsfm {

// The refinements of translation_averaging/translation_stages.h with bilinear
// residuals (BATA, Zhuang et al. 2018; global positioning of GLOMAP; eqs. (14),
// (15) of MGSfM with its rig constraint (2)): every direction v of a difference
// C of positions gets a scale d as one more unknown,
//
//   rho(|w (v - d C)|),  d >= 1e-5,
//
// with C = p - c_i of points and C = c_j - c_i of pairs, c_i = c^g - R_i^T t^r.
// Known lengths s of pairs, which angles do not determine on straight motion,
// add residuals w' (d s - 1); baselines without parallax add w C. Weights,
// losses and annealing are as in the non-bilinear refinements.
//
// Unknowns: free frame centers, sensor translations, points, and all d. Gauge:
// the first frame is constant; linear terms hold the unobservable directions of
// sensor translations. The scale is free, steps are damped. Start: d = 1 / |C|;
// d = 1 if positions start at random.
//
// Solver: Ceres, Levenberg-Marquardt with sparse normal equations, whatever
// options.backend is. Stops when the relative decrease of the cost is below
// function_tolerance. It runs on one thread, because sums in Ceres depend on
// the number of threads.
SolveSummary RefineCamerasBilinearly(const RefinementInput& input,
                                     const RefinementOptions& options,
                                     const Context& context,
                                     Positions* positions);
SolveSummary RefineCamerasAndPointsBilinearly(
    const RefinementInput& input, const TrackRays& rays,
    const std::vector<size_t>& track_idxs, const RefinementOptions& options,
    const Context& context, PositionsAndPoints* placed);

constexpr PositionObjective kBilinearObjective = {
    RefineCamerasBilinearly, RefineCamerasAndPointsBilinearly};

}  // namespace mgsfm

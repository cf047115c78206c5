// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <vector>

#include "mgsfm/base/context.h"
#include "mgsfm/base/solver.h"
#include "translation_averaging/refinement_terms.h"

namespace mgsfm {

// Refines frame centers and sensor translations by eq. (16) of MGSfM,
//
//   min sum_p rho(w_p |b_p - C_p / |C_p||),
//
// with the directions b_p and baselines C_p of pairs, a Cauchy loss rho whose
// scale is annealed to loss_scale_rad, and terms w log(|C_p| / s_p) that keep
// the measured lengths s_p, which directions leave open on straight motion.
// Gauge: the first frame is constant; the unit of length follows from the s_p.
// Levenberg-Marquardt (rig_solver/rig_solver.h); stops when the relative
// decrease of the cost is below function_tolerance.
SolveSummary RefineCameras(const RefinementInput& input,
                           const RefinementOptions& options,
                           const Context& context, Positions* positions);

// Refines them together with points p_k by eq. (18) of MGSfM,
//
//   min sum_ik rho(|g_ik - (p_k - c_i) / |p_k - c_i||) + pairs,
//
// over the used observations of the tracks track_idxs, with rays g in world
// axes. The pair terms are those above with a tenth of their weight and without
// lengths; they constrain frames that too few points constrain. Gauge: the
// first frame is constant, and the farthest unknown keeps its length unless
// known sensor offsets determine the unit. Points are eliminated (Schur
// complement).
SolveSummary RefineCamerasAndPoints(const RefinementInput& input,
                                    const TrackRays& rays,
                                    const std::vector<size_t>& track_idxs,
                                    const RefinementOptions& options,
                                    const Context& context,
                                    PositionsAndPoints* placed);

constexpr PositionObjective kNonBilinearObjective = {RefineCameras,
                                                     RefineCamerasAndPoints};

}  // namespace mgsfm

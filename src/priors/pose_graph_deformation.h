// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <optional>
#include <vector>

#include "mgsfm/base/context.h"
#include "mgsfm/base/mask.h"
#include "mgsfm/priors/prior_summaries.h"
#include "mgsfm/scene/estimates.h"
#include "mgsfm/scene/position_priors.h"
#include "mgsfm/scene/scene.h"
#include "mgsfm/scene/view_graph.h"

namespace mgsfm {

// Bends a model that was moved into the world of measured positions as a whole,
// so that it follows them where it drifted: what one similarity leaves would be
// too far for bundle adjustment, whose loss takes it for outliers.
//
// Each frame f carries its surroundings along, x -> c'_f + e^s_f Q_f (x - c_f).
// With D = c_g - c_f between the centres of two frames that images pairs link,
//
//   min  sum_fg [ |c'_g - c'_f - (e^s_f Q_f + e^s_g Q_g) D / 2|^2 / |D|^2
//                 + |Log(Q_f^T Q_g)|^2 + (s_g - s_f)^2 ] / sigma^2
//      + sum_i rho((c'_i - g_i)^T C_i^-1 (c'_i - g_i))
//
// over c', Q and s, with the position g_i of image i and its covariance C_i.
// Lengths |D| below a tenth of their median count as that. s = 0 if the model
// is metric, or a rig has cameras at different places, as then scale does not
// drift. rho: Cauchy of scale max(2.8, 2 medians) of the distances in standard
// deviations, anew in each step: one that forgets what is far would take a
// stretch that drifted for outliers. The rest of the gauge needs nothing: the
// positions tell it, or a damping of 1e-9 does.
//
// A model of which three quarters of the positions are at most three standard
// deviations off stays as it is, to the bit. Else sigma is 0.01, 0.04, 0.16,
// 0.64 degrees (and as much of a length), until that is so and the last did not
// bring more positions within max(4, 3 medians): as stiff as they allow. Per
// sigma at most 8 Gauss-Newton steps, ending when none moves a frame by more
// than 1e-3 standard deviations. Cost of a step: one sparse Cholesky
// factorisation of 7 unknowns a frame.
//
// Points are moved by the mean of the frames that see them.
//
// What is within max(4, 3 medians) in the end joins `used`. nullopt: nothing
// changed, as nothing had to, or as the result was no better.
std::optional<ModelDeformation> DeformToPriors(
    const Scene& scene, const ViewGraph& view_graph, const Mask& pair_is_used,
    const PositionPriors& priors, bool is_metric, const Context& context,
    PositionPriors* used, Reconstruction* reconstruction);

}  // namespace mgsfm

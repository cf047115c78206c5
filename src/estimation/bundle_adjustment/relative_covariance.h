// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <optional>
#include <utility>
#include <vector>

#include "mgsfm/base/context.h"
#include "mgsfm/bundle_adjustment/bundle_adjustment.h"
#include "mgsfm/geometry/rigid3.h"
#include "mgsfm/scene/estimates.h"
#include "mgsfm/scene/scene.h"

namespace mgsfm {

// Covariances of the poses of frames relative to others, from the noise of the
// keypoints around them.
//
// Objective: the one in bundle_adjustment.h without priors, at the model. The
// covariance is sigma^2 (J^T W J)^-1 with the weights W of its robust loss. The
// noise sigma is estimated from the points below. Unknowns: the poses of both
// frames and of the 40 frames that share most points with each of them, and the
// points that at least two of them observe. Sensors and intrinsics are
// constant, because all frames of the model determine them. Observations in
// other frames are ignored. Gauge: as in bundle_adjustment.h. The relative pose
// does not depend on the fixed frame. If no two sensors determine the scale,
// one coordinate of a nearby frame fixes it.
//
// With rotations R and centers c, the coordinates of the pose of the second
// frame in the first are those of R_2 R_1^T <- Exp(w) R_2 R_1^T and
// p <- p + d, p = R_1 (c_2 - c_1), so that changes of both poses cause
//
//   w = w_2 - R_2 R_1^T w_1,   d = R_1 (d_2 - d_1) - [p]_x w_1.
//
// One entry per pair (first, second). nullopt if a frame observes no point, the
// equations cannot be solved, or the standard deviation of w exceeds 10
// degrees, where its linearization is meaningless. Cost per pair: linear in the
// observations nearby, and a factorization for at most 82 frames.
[[nodiscard]] std::vector<std::optional<PoseMatrix>> ComputeRelativeCovariances(
    const Scene& scene, const Reconstruction& reconstruction,
    const BundleAdjustmentOptions& options,
    const std::vector<std::pair<int, int>>& frame_pairs,
    const Context& context);

}  // namespace mgsfm

// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include "mgsfm/base/mask.h"
#include "mgsfm/rotation_averaging/rotation_averaging.h"
#include "mgsfm/scene/estimates.h"
#include "mgsfm/scene/priors.h"
#include "mgsfm/scene/scene.h"
#include "mgsfm/scene/view_graph.h"

namespace mgsfm {

// An estimate whose inliers are some of the pairs. Frames are renumbered by the
// components that these pairs connect (mgsfm/scene/estimates.h). A frame that
// no such pair connects with another frame loses its rotation, and the pairs
// within it are not inliers. Rotations of sensors do not change.
[[nodiscard]] RotationEstimate RestrictToPairs(const Scene& scene,
                                               const ViewGraph& view_graph,
                                               const Mask& pair_is_kept,
                                               RotationEstimate estimate);

// Sets the fields of a summary that describe an estimate: the numbers of
// components and pairs, and the agreement with gravity priors.
void SummarizeEstimate(const Scene& scene, const ViewGraph& view_graph,
                       const RotationEstimate& estimate,
                       const GravityPriors& gravity,
                       const RotationAveragingOptions& options,
                       RotationSummary* summary);

}  // namespace mgsfm

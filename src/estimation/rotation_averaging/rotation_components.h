// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include "mgsfm/base/mask.h"
#include "mgsfm/rotation_averaging/rotation_averaging.h"
#include "mgsfm/scene/estimates.h"
#include "mgsfm/scene/priors.h"
#include "mgsfm/scene/scene.h"
#include "mgsfm/scene/view_graph.h"

namespace mgsfm {

// An estimate whose inliers are some of the pairs. Frames are numbered anew by
// the components these pairs connect (mgsfm/scene/estimates.h). A frame that
// no such pair connects with another loses its rotation, and the pairs within
// it are no inliers. Rotations of sensors stay.
[[nodiscard]] RotationEstimate RestrictToPairs(const Scene& scene,
                                               const ViewGraph& view_graph,
                                               const Mask& pair_is_kept,
                                               RotationEstimate estimate);

// Sets what a summary says of an estimate: its number of components, the
// numbers of pairs, and the agreement with gravity priors.
void SummarizeEstimate(const Scene& scene, const ViewGraph& view_graph,
                       const RotationEstimate& estimate,
                       const GravityPriors& gravity,
                       const RotationAveragingOptions& options,
                       RotationSummary* summary);

}  // namespace mgsfm

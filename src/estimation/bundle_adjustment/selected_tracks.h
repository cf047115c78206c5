// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <cstddef>

#include "mgsfm/bundle_adjustment/bundle_adjustment.h"

namespace mgsfm {

// RefineReconstruction() for the tracks of the points of a model, in little
// memory. It solves iteratively for a selection of the tracks, with at most so
// many observations: the longest ones that cover all images about equally. All
// tracks are then triangulated with the resulting poses and intrinsics. Memory:
// that of the solves for the selection, and the model twice.
[[nodiscard]] BundleResult RefineBySelectedTracks(
    const Scene& scene, Reconstruction initial,
    const BundleAdjustmentOptions& options, size_t max_num_observations,
    const Context& context);

}  // namespace mgsfm

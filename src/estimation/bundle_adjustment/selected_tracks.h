// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <cstddef>

#include "mgsfm/bundle_adjustment/bundle_adjustment.h"

namespace mgsfm {

// RefineReconstruction() on the tracks of a model, with little memory. It
// solves iteratively for a selection of the tracks with a limited number of
// observations: the longest ones that cover all images about equally. All
// tracks are then triangulated with the resulting poses and intrinsics. Memory:
// the solves for the selection, and the model twice.
[[nodiscard]] BundleResult RefineBySelectedTracks(
    const Scene& scene, Reconstruction initial,
    const BundleAdjustmentOptions& options, size_t max_num_observations,
    const Context& context, const RefinementConditions& conditions = {});

}  // namespace mgsfm

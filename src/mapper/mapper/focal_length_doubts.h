// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <vector>

#include "mgsfm/base/context.h"
#include "mgsfm/input_check/finding.h"
#include "mgsfm/mapper/mapper.h"
#include "mgsfm/scene/scene.h"

namespace mgsfm {

// Few pairs, little motion and pairs on vehicles can mislead the check of
// trusted focal lengths (input_check/focal_lengths.h). This keeps the doubts
// (kWrongFocalLength) that the whole model confirms: bundle adjustment of the
// largest model with free focal lengths moves them in the direction of the
// doubt by more than half of its bound. Doubts about cameras without a model
// remain.
//
// Cost: one bundle adjustment if there are doubts, otherwise none.
std::vector<Finding> ConfirmedFocalLengthDoubts(
    const Scene& scene, const std::vector<MapperModel>& models,
    const BundleAdjustmentOptions& options, const Context& context,
    std::vector<Finding> doubts);

}  // namespace mgsfm

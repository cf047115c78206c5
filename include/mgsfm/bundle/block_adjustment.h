// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <vector>

#include "mgsfm/base/context.h"
#include "mgsfm/bundle/bundle_adjustment.h"
#include "mgsfm/scene/estimates.h"
#include "mgsfm/scene/scene.h"

namespace mgsfm {

// Bundle adjustment with the points of one block of frames at a time in the
// equations.
//
// A point belongs to the first block that has a frame which observes it. Its
// elimination leaves equations for frames, sensors and cameras. Those of all
// blocks are added and solved; the step of the points follows block by block.
// Cost, steps and stopping criteria are those of Levenberg-Marquardt on the
// whole model, therefore both have the same minimum
// (docs/maths/bundle.md#blocks). Each iteration visits every block once and
// linearises it twice.
//
// Memory: the model, the equations of the largest block, and twice the sparse
// system of all frames with its factor.
using FrameBlocks = std::vector<int>;  // per frame of the scene, from 0

// RefineReconstruction() by blocks.
[[nodiscard]] BundleResult RefineInBlocks(
    const Scene& scene, const CandidateSource& candidates,
    const FrameBlocks& blocks, Reconstruction initial,
    const BundleAdjustmentOptions& options, const Context& context);

}  // namespace mgsfm

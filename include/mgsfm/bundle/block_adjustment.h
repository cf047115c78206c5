// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <vector>

#include "mgsfm/base/context.h"
#include "mgsfm/bundle/bundle_adjustment.h"
#include "mgsfm/scene/estimates.h"
#include "mgsfm/scene/scene.h"

namespace mgsfm {

// Bundle adjustment of a model whose equations do not fit the memory.
//
// The frames are divided into blocks. A point belongs to the first block that
// has a frame which observes it. Frames with points of several blocks are
// shared, and so are rig extrinsics and intrinsics.
//
// One block at a time is in memory. Its points are eliminated, then its inner
// frames, so that a small system of the shared unknowns remains. These systems
// are added and solved; the step of the inner frames and points follows block
// by block. Cost, steps and stopping criteria are those of Levenberg-Marquardt
// on the whole model, therefore both have the same minimum. Each iteration
// visits every block once and linearises it twice.
//
// Memory: the model, the equations of the largest block, and for each block the
// square of its number of shared unknowns.
using FrameBlocks = std::vector<int>;  // per frame of the scene, from 0

// AdjustBundle() by blocks.
[[nodiscard]] BundleResult AdjustBundleInBlocks(
    const Scene& scene, const FrameBlocks& blocks,
    const Reconstruction& initial, const BundleAdjustmentOptions& options,
    const Context& context);

// RefineReconstruction() by blocks.
[[nodiscard]] BundleResult RefineInBlocks(
    const Scene& scene, const CandidateSource& candidates,
    const FrameBlocks& blocks, Reconstruction initial,
    const BundleAdjustmentOptions& options, const Context& context);

}  // namespace mgsfm

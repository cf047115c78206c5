// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include "bundle/problem_builder.h"
#include "mgsfm/base/context.h"
#include "mgsfm/bundle/block_adjustment.h"

namespace mgsfm {

// SolveOnce() by blocks (mgsfm/bundle/block_adjustment.h).
bool SolveInBlocks(const Scene& scene, const BundleAdjustmentOptions& options,
                   RefinedParts parts, double function_tolerance,
                   const Context& context, BlockedModel* model,
                   BundleSummary* summary);

}  // namespace mgsfm

// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include "bundle/problem_builder.h"
#include "mgsfm/base/context.h"
#include "mgsfm/bundle/bundle_adjustment.h"
#include "mgsfm/scene/scene.h"

namespace mgsfm {

// Steps that AdjustBundle and RefineReconstruction share.

// Builds the problem of the estimate, solves it and appends to the summary. The
// estimate is left as it was if false is returned.
bool SolveOnce(const Scene& scene, const PositionPriors& priors,
               const HeldPoses& held, const BundleAdjustmentOptions& options,
               RefinedParts parts, double function_tolerance,
               const Context& context, BundleResult* result);

// Lists what the points of the estimate hardly constrain.
void FinishSummary(const Scene& scene, const Reconstruction& initial,
                   const BundleAdjustmentOptions& options,
                   BundleResult* result);

}  // namespace mgsfm

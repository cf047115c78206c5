// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include "bundle/point_filters.h"
#include "bundle/problem_builder.h"
#include "mgsfm/base/context.h"
#include "mgsfm/bundle/bundle_adjustment.h"
#include "mgsfm/scene/scene.h"

namespace mgsfm {

// Steps that AdjustBundle and RefineReconstruction share.

// Builds the problem of the estimate, solves it and appends to the summary. The
// estimate is left as it was if false is returned.
bool SolveOnce(const Scene& scene, const BundlePriors& priors,
               const FixedPoses& held, const BundleAdjustmentOptions& options,
               RefinedParts parts, double function_tolerance,
               const Context& context, BundleResult* result);

// What points and observations are to satisfy whose errors may be that large.
PointFilterOptions MakeFilterOptions(const Scene& scene,
                                     const Reconstruction& estimate,
                                     const BundleAdjustmentOptions& options,
                                     double max_error_px,
                                     const Context& context);

// The largest error of an observation that is no outlier, so many rounds before
// the last one.
double MaxErrorPx(const BundleAdjustmentOptions& options, double sigma_px,
                  int num_rounds_left);

// The threshold of the loss for keypoints of the given noise.
double LossScalePx(const BundleAdjustmentOptions& options, double sigma_px);

// Lists what the points of the estimate hardly constrain.
void FinishSummary(const Scene& scene, const Reconstruction& initial,
                   const BundleAdjustmentOptions& options,
                   BundleResult* result);

}  // namespace mgsfm

// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include "bundle_adjustment/point_filters.h"
#include "bundle_adjustment/problem_builder.h"
#include "mgsfm/base/context.h"
#include "mgsfm/bundle_adjustment/bundle_adjustment.h"
#include "mgsfm/scene/scene.h"

namespace mgsfm {

// Steps shared by AdjustBundle, RefineReconstruction and EstimateSoftRig.

struct SolveMode {
  RefinedParts parts = RefinedParts::kAll;
  // See rig_solver.h. Problems with free intrinsics do so in any case: in the
  // long valley of focal lengths and depths, joint steps of all points are
  // short.
  bool minimizes_points = false;
};

// Solves the problem of the estimate and appends to the summary. Returns false,
// and does not change the estimate, if the solve fails.
bool SolveOnce(const Scene& scene, const RefinementConditions& conditions,
               const BundleAdjustmentOptions& options, SolveMode mode,
               const Context& context, BundleResult* result);

// The point filter for this bound on reprojection errors.
PointFilterOptions MakeFilterOptions(const Scene& scene,
                                     const Reconstruction& estimate,
                                     const BundleAdjustmentOptions& options,
                                     double max_error_px,
                                     const Context& context);

// The bound on inlier reprojection errors; it doubles with each round left.
double MaxErrorPx(const BundleAdjustmentOptions& options, double sigma_px,
                  int num_rounds_left);

// The bound on the root mean square reprojection error of a point.
double MaxRmsErrorPx(const BundleAdjustmentOptions& options, double sigma_px);

// The scale of the loss at this keypoint noise.
double LossScalePx(const BundleAdjustmentOptions& options, double sigma_px);

// Lists weak frames and sensors without observations.
void FinishSummary(const Scene& scene, const Reconstruction& initial,
                   const BundleAdjustmentOptions& options,
                   BundleResult* result);

// The points with the longest tracks that cover all images about equally, as
// many as the limit allows.
std::vector<Point3D> SelectPoints(const Scene& scene,
                                  const std::vector<Point3D>& points,
                                  size_t max_num_observations);

// RefineReconstruction() on the tracks of a model, with little memory. It
// solves iteratively for SelectPoints(). All tracks are then triangulated with
// the resulting poses and intrinsics. Memory: the solves for the selection, and
// the model twice.
[[nodiscard]] BundleResult RefineBySelectedTracks(
    const Scene& scene, Reconstruction initial,
    const BundleAdjustmentOptions& options, size_t max_num_observations,
    const Context& context, const RefinementConditions& conditions = {});

}  // namespace mgsfm

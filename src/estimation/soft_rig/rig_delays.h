// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <optional>
#include <utility>
#include <vector>

#include "mgsfm/base/context.h"
#include "mgsfm/bundle_adjustment/bundle_adjustment.h"
#include "mgsfm/bundle_adjustment/uncertainty.h"
#include "mgsfm/scene/estimates.h"
#include "mgsfm/scene/scene.h"
#include "mgsfm/soft_rig/rig_delays.h"
#include "soft_rig/rig_scores.h"
#include "soft_rig/rig_trajectory.h"

namespace mgsfm {

// Knowledge about the rig other than images.
struct RigMeasurements {
  CaptureTimes times;
  // Pairs of sensors whose known distance defines the unit of length.
  std::vector<std::pair<int, int>> known_distances;
};

// Estimates how late the cameras of an adjusted model trigger. The delays, the
// poses of sensors (with priors if known), frames and points jointly minimize
// the objective of bundle adjustment. Standard deviations come from a jackknife
// over ten blocks of consecutive frames, so they hold for residuals that are
// correlated within a block.
//
// The model lacks observations that contradict a rigid rig, so the points are
// triangulated again from `candidates` as the delays become known, but only if
// some delay exceeds four standard deviations of independent residuals. The
// unit of length is tested with these delays. nullopt without rigs of several
// cameras, or if the equations cannot be factorized.
[[nodiscard]] std::optional<RigDelays> EstimateRigDelays(
    const Scene& scene, const RigMeasurements& measured,
    const CandidateSource& candidates, const Reconstruction& model,
    const BundleAdjustmentOptions& options, const Context& context);

// Adds the errors that the residuals reveal to covariances of the rigid model:
// the overdispersion of blocks (for sensors also that of points if larger) and
// the errors due to delays that the model ignores.
void AddRigErrors(const Scene& scene, const Reconstruction& model,
                  const RigDelays& delays, CovarianceResult* covariances);

}  // namespace mgsfm

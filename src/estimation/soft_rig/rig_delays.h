// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <functional>
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

namespace mgsfm {

// The error of the unit of length of `model`, which known poses of sensors or
// the known distances of pairs of sensors define. `scores` have a fixed scale
// (RigGauge::kFixedScale) and are those of `rig`, which starts at `model` and
// may have delays.
//
// At a fixed scale of the world, the baselines of known poses are exp(u) times
// the known ones. u is estimated with the poses, which have their priors, and
// the delays. nullopt if there is no known length, or if the frames are closer
// together than the sensors: the rig itself is the largest length then.
std::optional<UnitError> EstimateUnitError(
    const Scene& scene, const RigScores& scores, const DelayedRig& rig,
    const Reconstruction& model,
    const std::vector<std::pair<int, int>>& known_distances,
    const BundleAdjustmentOptions& options);

// The time of each frame: in seconds, or its number in the order of its rig.
struct FrameTimes {
  std::vector<double> times;
  bool are_seconds = false;
};

// What is known beside the images.
struct RigMeasurements {
  FrameTimes times;
  // Pairs of sensors whose known distance defines the unit of length.
  std::vector<std::pair<int, int>> known_distances;
};

// Estimates how late the cameras of an adjusted model trigger. The delays, the
// poses of sensors (known ones with their prior), frames and points minimize
// the objective of bundle adjustment together. Standard deviations are those of
// a jackknife over ten blocks of consecutive frames, so that they hold for
// residuals that depend on each other within a block.
//
// The model has lost observations that contradict a rigid rig, so that the
// points are triangulated again as the delays become known. That is only done
// if some delay exceeds four standard deviations of independent residuals.
// `candidates` is called for that. The unit of length is judged with these
// delays. nullopt without rigs of several cameras, or
// if the equations cannot be factorized.
[[nodiscard]] std::optional<RigDelays> EstimateRigDelays(
    const Scene& scene, const RigMeasurements& measured,
    const std::function<CandidateSource(const Scene& separate)>& candidates,
    const Reconstruction& model, const BundleAdjustmentOptions& options,
    const Context& context);

// Adds to covariances of the rigid model what its residuals show: the
// overdispersion of blocks, for sensors also that of points if it is larger,
// and the errors by delays that the model does not have.
void AddRigErrors(const Scene& scene, const Reconstruction& model,
                  const RigDelays& delays, CovarianceResult* covariances);

}  // namespace mgsfm

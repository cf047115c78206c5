// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <optional>
#include <utility>
#include <vector>

#include "mgsfm/bundle_adjustment/bundle_adjustment.h"
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

}  // namespace mgsfm

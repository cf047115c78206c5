// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <optional>
#include <vector>

#include "mgsfm/base/context.h"
#include "mgsfm/base/mask.h"
#include "mgsfm/base/timer.h"
#include "mgsfm/geometry/rigid3.h"
#include "mgsfm/pipeline/mapper.h"
#include "mgsfm/scene/priors.h"
#include "mgsfm/scene/scene.h"
#include "mgsfm/scene/view_graph.h"
#include "pair_filtering/frame_pair_index.h"
#include "pipeline/rotation_recipe.h"
#include "translation/scale_averaging.h"

namespace mgsfm {

struct RotationsOfScene {
  EstimatedRotations rotation;
  LengthHints length_hints;
  std::vector<std::optional<Rigid3>> pair_on_path;  // per pair, or empty
  Mask frame_is_ambiguous;                          // per frame, or empty
};

// Rotations (rotation_recipe.h). In a sequence where objects move along with
// the rig (motion_recipe.h), the matches of the static scene replace those of
// `view_graph`, and rotations are averaged again.
[[nodiscard]] RotationsOfScene EstimateRotationsOfScene(
    const Scene& scene, const Bearings& bearings, const FramePairIndex& index,
    const ViewGraph& matches, const GravityPriors& gravity_priors,
    const MapperOptions& options, const Context& context, ViewGraph* view_graph,
    std::vector<StageTime>* times);

}  // namespace mgsfm

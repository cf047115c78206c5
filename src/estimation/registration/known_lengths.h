// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <optional>

#include "mgsfm/base/context.h"
#include "mgsfm/registration/model_extension.h"
#include "mgsfm/scene/estimates.h"
#include "mgsfm/scene/scene.h"
#include "mgsfm/scene/view_graph.h"

namespace mgsfm {

struct KnownLengthsInput {
  const Scene& scene;
  const Bearings& bearings;
  const ViewGraph& view_graph;
  const Reconstruction& start;
};

// A known rig that is new to the model may have another unit of length, and its
// frames would then deform the model. Its sensors are therefore calibrated as
// if they were unknown, and the known lengths are scaled to the unit of the
// model. nullopt if no length differs.
[[nodiscard]] std::optional<Scene> AdaptKnownLengths(
    const KnownLengthsInput& input, const ResectionOptions& options,
    const Context& context);

// Whether the known pose of a sensor determines a length.
[[nodiscard]] bool HasKnownLength(const Sensor& sensor);

}  // namespace mgsfm

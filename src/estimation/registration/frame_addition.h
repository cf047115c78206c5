// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <functional>
#include <optional>
#include <vector>

#include "mgsfm/base/context.h"
#include "mgsfm/bundle_adjustment/bundle_adjustment.h"
#include "mgsfm/registration/model_extension.h"
#include "mgsfm/scene/estimates.h"
#include "mgsfm/scene/scene.h"
#include "mgsfm/scene/view_graph.h"

namespace mgsfm {

// Adds the frames of a scene that a model lacks
// (mgsfm/registration/model_extension.h).

struct FrameAdditionInput {
  const Scene& scene;
  const Bearings& bearings;
  const ViewGraph& view_graph;
  const Reconstruction& start;
};

struct ExtendedModel {
  Reconstruction model;
  ExtensionSummary summary;
  std::vector<ResectedFrame> rejected;  // frames that could not be added
};

// Resects frames, triangulates their points and refines both, until no frame or
// sensor is added. `observer` sees the model after each pass; it may be null.
[[nodiscard]] ExtendedModel AddFrames(
    const FrameAdditionInput& input, const CandidateSource& candidates,
    const ResectionOptions& resection, const BundleAdjustmentOptions& options,
    const Context& context,
    const std::function<void(const Reconstruction&)>& observer);

// A known rig that is new to the model may have another unit of length, and its
// frames would then deform the model. Its sensors are therefore calibrated as
// if they were unknown, and the known lengths are scaled to the unit of the
// model. nullopt if no length differs.
[[nodiscard]] std::optional<Scene> AdaptKnownLengths(
    const FrameAdditionInput& input, const ResectionOptions& options,
    const Context& context);

// Whether the known pose of a sensor determines a length.
[[nodiscard]] bool HasKnownLength(const Sensor& sensor);

}  // namespace mgsfm

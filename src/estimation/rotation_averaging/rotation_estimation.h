// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <optional>
#include <string>

#include "mgsfm/base/context.h"
#include "mgsfm/base/mask.h"
#include "mgsfm/pair_filtering/pair_filtering.h"
#include "mgsfm/rotation_averaging/rotation_averaging.h"
#include "mgsfm/scene/estimates.h"
#include "mgsfm/scene/priors.h"
#include "mgsfm/scene/scene.h"
#include "mgsfm/scene/view_graph.h"
#include "pair_filtering/frame_pair_index.h"

namespace mgsfm {

struct RotationInput {
  const Scene& scene;
  const ViewGraph& view_graph;
  const FramePairIndex& index;  // of the view graph
  const GravityPriors& gravity = kNoGravity;
  // The verdicts of earlier rules, per pair; empty if no pair is rejected.
  PairVerdicts verdicts = {};
};

struct RotationOptions {
  const RotationAveragingOptions& averaging;
  const PairFilteringOptions& filtering;
};

struct EstimatedRotations {
  RotationEstimate estimate;
  RotationSummary summary;
  PairVerdicts verdicts;  // per pair; nullopt for the inliers of the estimate
  // Why gravity priors were not used; nullopt if they were used.
  std::optional<std::string> gravity_rejection;
};

// Rotations that resist duplicate structures: rotation averaging
// (mgsfm/rotation_averaging/rotation_averaging.h) and the rules of
// mgsfm/pair_filtering/pair_filtering.h on rotations, in this order:
//
//   skeletal graph -> average its pairs -> reject pairs beyond its drift bound
//   -> average the others, from the rotations of the skeletal graph
//   -> reject loop pairs that join parts without support
//   -> average again, until there are none
//   -> reject other unsupported bridges -> number components.
//
// Gravity priors take part in the second averaging only. They are rejected if
// more than 5 % of the pairs that agree without them disagree with them: wrong
// priors would disconnect the frames. Without any relative pose, the estimate
// contains only known sensors, and a warning is logged. Pairs that earlier
// rules rejected (moving_objects.h) take no part.
[[nodiscard]] EstimatedRotations EstimateRotations(
    const RotationInput& input, const RotationOptions& options,
    const Context& context);

// An estimate whose inliers are some of the pairs. Frames are renumbered by the
// components that these pairs connect (mgsfm/scene/estimates.h). A frame that
// no such pair connects with another frame loses its rotation, and the pairs
// within it are not inliers. Rotations of sensors do not change.
[[nodiscard]] RotationEstimate RestrictToPairs(const Scene& scene,
                                               const ViewGraph& view_graph,
                                               const Mask& pair_is_kept,
                                               RotationEstimate estimate);

// Sets the fields of a summary that describe an estimate: the numbers of
// components and pairs, and the agreement with gravity priors.
void SummarizeEstimate(const Scene& scene, const ViewGraph& view_graph,
                       const RotationEstimate& estimate,
                       const GravityPriors& gravity,
                       const RotationAveragingOptions& options,
                       RotationSummary* summary);

}  // namespace mgsfm

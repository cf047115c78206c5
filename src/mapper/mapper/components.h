// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <string>
#include <vector>

#include "mapper/verified_pairs.h"
#include "mgsfm/base/context.h"
#include "mgsfm/base/mask.h"
#include "mgsfm/mapper/mapper.h"
#include "mgsfm/scene/estimates.h"
#include "pair_filtering/frame_pair_index.h"
#include "rotation_averaging/rotation_estimation.h"

namespace mgsfm {

// The connected components of the view graph; each becomes a model.

// The number of frames of each component.
[[nodiscard]] std::vector<int> CountFramesOfComponents(
    const RotationEstimate& rotations);

// The estimate restricted to one component.
[[nodiscard]] RotationEstimate SelectComponent(const VerifiedPairs& pairs,
                                               const RotationEstimate& all,
                                               int component);

// Groups of pairs that the rotations or positions of a component contradict.
// Pairs on moving objects are no evidence against either. Logs their number.
[[nodiscard]] std::vector<RejectedGroup> FindRejectedGroups(
    const VerifiedPairs& pairs, const FramePairIndex& index,
    const RotationEstimate& rotations, const Mask& pair_is_inconsistent,
    const PairVerdicts& verdicts, const Context& context);

// Sorts the models by descending number of frames, which splitting a component
// changes, and drops those of fewer than min_model_size images, but never the
// first one. Returns the frames of dropped models.
Mask KeepLargeModels(const Scene& scene, const MapperOptions& options,
                     std::vector<MapperModel>* models);

// Lists the frames that are in no model, with the reason.
void ListUnregistered(const Scene& scene, const EstimatedRotations& rotations,
                      const Mask& frame_is_ambiguous,
                      const Mask& is_in_small_model,
                      const MapperOptions& options, MapperResult* result);

// Lists the frames without a pose in one model, with the reason of its bundle
// adjustment or else the given one.
void ListFramesWithoutPose(const MapperModel& model,
                           std::vector<std::string> reasons,
                           MapperResult* result);

// Whether one of the models has a frame.
[[nodiscard]] bool IsInModel(const std::vector<MapperModel>& models,
                             size_t frame_idx);

}  // namespace mgsfm

// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <functional>
#include <vector>

#include "mapper/verified_pairs.h"
#include "mgsfm/base/context.h"
#include "mgsfm/base/mask.h"
#include "mgsfm/mapper/mapper.h"
#include "moving_objects/moving_objects.h"
#include "pair_filtering/frame_pair_index.h"
#include "rotation_averaging/rotation_estimation.h"
#include "translation_averaging/position_estimation.h"

namespace mgsfm {

// The inputs of a run. Runs with a subset of the pairs calibrate lenses.
struct MapperRunInput {
  const MapperInput& input;  // beside scene and pairs
  const Scene& scene;        // with the lenses to start from
  const ViewGraph& matches;
  const CalibrationPrior& lenses;
  const MapperOptions& options;
  const Context& context;
};

// Maps the verified pairs of a scene.
using PairStep = std::function<void(
    const MapperRunInput& run, VerifiedPairs* pairs, MapperResult* result)>;

// RunMapper() with another step. Lenses, verification, the extension of an
// existing model and the checks of the input are shared.
[[nodiscard]] MapperResult RunMapperBy(const PairStep& map_pairs,
                                       const MapperInput& input,
                                       const MapperOptions& options,
                                       const Context& context);

struct JudgedPairs {
  EstimatedRotations rotations;  // with a verdict per pair
  MotionOfScene motion;
};

// Averages rotations, finds moving objects, and averages again without them.
// Objects are sought in pairs of the given frames; nullptr: of all.
[[nodiscard]] JudgedPairs JudgePairs(const MapperRunInput& run,
                                     const FramePairIndex& index,
                                     const Mask* frames_with_objects,
                                     VerifiedPairs* pairs,
                                     std::vector<StageTime>* times);

// Pairs that no rule rejects. A pair that averaging could not reach is used.
[[nodiscard]] Mask UsablePairs(const PairVerdicts& verdicts);

// The step from rotations to positions and points; EstimatePositions() in the
// mapper.
using PositionStep = std::function<PositionResult(
    const PositionInput& input, const PositionOptions& options,
    const Context& context)>;

// RunMapper() with another such step, for comparisons with other methods.
[[nodiscard]] MapperResult RunMapperWith(const PositionStep& estimate_positions,
                                         const MapperInput& input,
                                         const MapperOptions& options,
                                         const Context& context);

// RunMapper() with incremental instead of global estimation
// (mgsfm/incremental/incremental_mapping.h). Lenses, verification of pairs, the
// final adjustment, seams, checks and the report are those of the mapper.
[[nodiscard]] MapperResult RunIncrementalMapper(const MapperInput& input,
                                                const MapperOptions& options,
                                                const Context& context);

}  // namespace mgsfm

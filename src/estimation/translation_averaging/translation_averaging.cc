// SPDX-License-Identifier: BSD-3-Clause
#include "mgsfm/translation_averaging/translation_averaging.h"

#include <utility>

#include "base/format.h"
#include "mgsfm/base/error.h"
#include "mgsfm/base/timer.h"
#include "translation_averaging/translation_stages.h"

namespace mgsfm {
namespace {

// Logs the time of each step.
class StepLog {
 public:
  explicit StepLog(const Context& context) : context_(context) {}
  void Finish(const char* step) {
    context_.Debug(Formatted("positions: %s %.3f s", step, timer_.Seconds()));
    timer_ = Timer();
  }

 private:
  const Context& context_;
  Timer timer_;
};

void Check(const TranslationAveragingInput& input) {
  MGSFM_CHECK_EQ(input.rotations.pair_is_inlier.size(),
                 input.view_graph.pairs.size());
  MGSFM_CHECK_EQ(input.rotations.rig_from_world.size(),
                 input.scene.frames.size());
  MGSFM_CHECK_EQ(input.bearings.images.size(), input.scene.images.size());
}

// Stage 1: directions and lengths of the baselines of pairs.
TranslationState MeasureAllPairs(const TranslationAveragingInput& input,
                                 const TranslationAveragingOptions& options,
                                 const Context& context,
                                 const LengthHints& hints) {
  TranslationState state;
  state.problem = MakePositionProblem(input.scene, input.rotations);
  state.pair_is_used = input.rotations.pair_is_inlier;
  state.pairs = MeasurePairs({input.scene, input.bearings, input.view_graph,
                              state.pair_is_used, state.problem},
                             options.min_parallax_deg, context, hints);
  return state;
}

// Stage 2: L1 positions.
void InitializeByPairs(const TranslationAveragingOptions& options,
                       const Context& context, TranslationState* state) {
  InitializationOptions initialization{options.min_parallax_deg};
  initialization.relative_tolerance = kStartTolerance;
  state->initial =
      InitializePositions(state->ToInitialize(), initialization, context);
}

}  // namespace

TranslationResult AverageTranslations(
    const TranslationAveragingInput& input,
    const TranslationAveragingOptions& options, const Context& context,
    const TranslationHooks* hooks_or_null) {
  Check(input);
  const TranslationHooks no_hooks;
  const TranslationHooks& hooks = hooks_or_null ? *hooks_or_null : no_hooks;
  StepLog log(context);
  TranslationState state =
      MeasureAllPairs(input, options, context, hooks.length_hints);
  log.Finish("baselines of pairs");
  const TrackRays rays = ComputeTrackRays(state.problem, input.bearings,
                                          input.tracks, context.num_threads);
  const auto observe = [&] {
    if (!hooks.observer) return;
    PositionsAndPoints shown = state.placed;
    TriangulateAgain(state.ToRefine(), rays, kCoarseErrorRad, options,
                     context.num_threads, &shown);
    hooks.observer(MakePositionEstimate(input.scene, state.problem, shown));
  };
  if (hooks.initialize) {
    hooks.initialize(&state);
  } else {
    InitializeByPairs(options, context, &state);
  }
  state.placed.positions = state.initial.positions;
  log.Finish("L1 positions");
  observe();
  RefinedPositions cameras =
      RefineWithPairs(state.ToRefine(), options, context, hooks.objective);
  state.placed.positions = std::move(cameras.positions);
  log.Finish("refinement with pairs");
  observe();
  if (hooks.select_pairs && hooks.objective.refine_cameras) {
    hooks.select_pairs(&state);
  }
  TrackRefinement refined =
      RefineWithTracks(state.ToRefine(), state.placed.positions, rays, options,
                       context, hooks.objective);
  state.placed = std::move(refined.placed);
  log.Finish("refinement with tracks");
  if (!state.initial.is_metric) {
    ScaleBy(FactorToMeasuredLengths(state.ToRefine(), state.placed.positions),
            &state.placed);
  }
  TranslationResult result;
  result.estimate =
      MakePositionEstimate(input.scene, state.problem, state.placed);
  SummarizePairs(state.pairs, input.rotations.pair_is_inlier, &result.summary);
  SummarizeEstimate(state.problem, state.initial, result.estimate,
                    &result.summary);
  result.summary.initialization = state.initial.solve;
  result.summary.camera_refinement = std::move(cameras.solve);
  result.summary.joint_refinement = std::move(refined.solve);
  result.summary.num_frames_placed_by_points =
      refined.num_frames_placed_by_points;
  if (hooks.finish) hooks.finish(std::move(state));
  return result;
}

}  // namespace mgsfm

// SPDX-License-Identifier: BSD-3-Clause
#include "translation_averaging/position_estimation.h"

#include <limits>
#include <string>
#include <utility>
#include <vector>

#include "pair_filtering/displaced_steps.h"
#include "pair_filtering/skeletal_graph.h"
#include "pair_filtering/skeleton_consistency.h"
#include "translation_averaging/pose_graph.h"
#include "translation_averaging/scale_averaging.h"
#include "translation_averaging/translation_stages.h"

namespace mgsfm {
namespace {

// The positions of a skeleton only screen pairs, so their ADMM ends early. Half
// and twice the value do not change errors (docs/results/constants.md).
constexpr int kMaxNumSkeletonIterations = 60;

// A correction of rotations can leave a smaller displaced step. On the drives
// of docs/results/constants.md, one correction leaves none.
constexpr int kMaxNumCorrections = 3;

// The skeletal graph, and L1 positions from its pairs alone.
struct PositionSkeleton {
  Mask is_in_skeleton;
  InitialPositions initial;
};

BaselineComparison CompareMeasured(const TranslationState& state,
                                   const InitialPositions& initial,
                                   const Positions& positions) {
  return CompareWith(state.problem, state.pairs.baselines, state.pairs.scales,
                     initial.group_factor, positions);
}

InitialPositions InitializeWith(const TranslationState& state,
                                const Mask& pair_is_used,
                                const InitializationOptions& options,
                                const Context& context) {
  return InitializePositions(
      {state.problem, state.pairs.baselines, state.pairs.scales, pair_is_used},
      options, context);
}

PairEvidence EvidenceOf(const PositionInput& input, const Mask& pair_is_used,
                        const PairFilteringOptions& options,
                        int num_threads = 1) {
  return {input.scene,  input.index, input.view_graph,
          pair_is_used, options,     num_threads};
}

PositionSkeleton FindSkeleton(const PositionInput& input,
                              const TranslationState& state,
                              const PositionOptions& options,
                              const Context& context) {
  const std::vector<BaselineDirection>& baselines = state.pairs.baselines;
  Mask is_candidate(baselines.size());
  for (size_t i = 0; i < is_candidate.size(); ++i) {
    is_candidate[i] = baselines[i].kind == BaselineKind::kDirection;
  }
  Mask is_in_skeleton = SelectSkeletalGraph(
      EvidenceOf(input, is_candidate, options.filtering, context.num_threads));
  // Pairs without parallax also place the frames of the skeleton.
  Mask pair_is_used = is_in_skeleton;
  for (size_t i = 0; i < pair_is_used.size(); ++i) {
    if (baselines[i].kind == BaselineKind::kNoParallax) pair_is_used[i] = true;
  }
  return {std::move(is_in_skeleton),
          InitializeWith(state, pair_is_used,
                         {options.averaging.min_parallax_deg,
                          kMaxNumSkeletonIterations, kStartTolerance},
                         context)};
}

// L1 positions and the pairs that they use: the steps "skeleton" and 2.
void ScreenAndInitialize(const PositionInput& input,
                         const PositionOptions& options,
                         const InitializationOptions& initialization,
                         const Context& context, TranslationState* state) {
  const PairFilteringOptions& filtering = options.filtering;
  if (!filtering.use_skeletal_graph ||
      !IsRuleOn(RejectionReason::kBaselineBeyondDriftBound, filtering)) {
    state->initial =
        InitializeWith(*state, state->pair_is_used, initialization, context);
    return;
  }
  const PositionSkeleton skeleton =
      FindSkeleton(input, *state, options, context);
  const BaselineComparison by_skeleton =
      CompareMeasured(*state, skeleton.initial, skeleton.initial.positions);
  const Mask all = state->pair_is_used;
  int fewest_violated = std::numeric_limits<int>::max();
  for (const double drift_bound : BaselineDriftBounds(filtering)) {
    Mask pair_is_used = all;
    pair_is_used.Remove(FindInconsistentBaselines(
        EvidenceOf(input, all, filtering), skeleton.is_in_skeleton, by_skeleton,
        drift_bound));
    InitialPositions initial =
        InitializeWith(*state, pair_is_used, initialization, context);
    const int num_violated = CountViolatedSkeletonEdges(
        input.view_graph, skeleton.is_in_skeleton, by_skeleton,
        CompareMeasured(*state, initial, initial.positions), filtering);
    context.Debug("positions: drift bound " + std::to_string(drift_bound) +
                  " violates " + std::to_string(num_violated) +
                  " skeleton edges");
    if (num_violated < fewest_violated) {
      fewest_violated = num_violated;
      state->initial = std::move(initial);
      state->pair_is_used = std::move(pair_is_used);
    }
    if (num_violated == 0) break;
  }
}

// Pairs whose baselines contradict the positions.
Mask FindInconsistent(const PositionInput& input, const TranslationState& state,
                      const PairFilteringOptions& options) {
  if (!IsRuleOn(RejectionReason::kInconsistentBaseline, options)) {
    return Mask(input.view_graph.pairs.size(), false);
  }
  return FindInconsistentPairs(
      input.view_graph,
      CompareMeasured(state, state.initial, state.placed.positions), options);
}

// The step "judge". All pairs are tested, including those rejected before,
// because the final positions may agree with them.
PositionResult JudgePairs(const PositionInput& input,
                          const TranslationState& state,
                          TranslationResult averaged,
                          const PairFilteringOptions& options) {
  PositionResult result;
  result.estimate = std::move(averaged.estimate);
  result.summary = std::move(averaged.summary);
  result.pair_is_inconsistent = FindInconsistent(input, state, options);
  result.summary.num_pairs_inconsistent_with_positions =
      static_cast<int>(result.pair_is_inconsistent.Count());
  if (!IsRuleOn(RejectionReason::kInconsistentBaseline, options)) return result;
  const StepDeviations displaced = FindDisplacedSteps(
      EvidenceOf(input, input.rotations.pair_is_inlier, options),
      CompareMeasured(state, state.initial, state.placed.positions),
      result.estimate.frame_center_in_world);
  for (const auto& deviation : displaced) {
    if (!deviation) continue;
    ++result.summary.num_displaced_steps;
    result.displacement += deviation->norm();
  }
  return result;
}

// The lengths of pairs between frames; nullopt without a baseline.
std::vector<std::optional<double>> BaselineLengths(
    const FramePairIndex& index,
    const std::vector<std::optional<Rigid3>>& poses) {
  std::vector<std::optional<double>> lengths(poses.size());
  for (size_t i = 0; i < poses.size(); ++i) {
    if (!poses[i] || !index.Of(i).IsBetweenFrames()) continue;
    const double length = poses[i]->translation.norm();
    if (length > 0.0) lengths[i] = length;
  }
  return lengths;
}

// The result for one set of rotations, and their correction.
struct PositionsByRotations {
  PositionResult result;
  TranslationState state;
  Mask pair_is_screened;  // the pairs of L1 positions
};

PositionsByRotations EstimateByRotations(const PositionObjective& objective,
                                         const PositionInput& input,
                                         const PositionOptions& options,
                                         const Context& context) {
  InitializationOptions initialization{options.averaging.min_parallax_deg};
  if (objective.refine_cameras) {
    initialization.relative_tolerance = kStartTolerance;
  }
  PositionsByRotations by_rotations;
  TranslationHooks hooks;
  if (input.pair_on_path) {
    hooks.length_hints.expected =
        BaselineLengths(input.index, *input.pair_on_path);
  }
  hooks.objective = objective;
  hooks.observer = input.observer;
  hooks.initialize = [&](TranslationState* state) {
    ScreenAndInitialize(input, options, initialization, context, state);
    by_rotations.pair_is_screened = state->pair_is_used;
  };
  hooks.select_pairs = [&](TranslationState* state) {
    state->pair_is_used.Remove(
        FindInconsistent(input, *state, options.filtering));
  };
  hooks.finish = [&](TranslationState state) {
    by_rotations.state = std::move(state);
  };
  TranslationResult averaged =
      AverageTranslations({input.scene, input.bearings, input.view_graph,
                           input.rotations, input.tracks},
                          options.averaging, context, &hooks);
  by_rotations.result = JudgePairs(input, by_rotations.state,
                                   std::move(averaged), options.filtering);
  Mask& is_beyond = by_rotations.result.pair_is_beyond_drift_bound;
  is_beyond = by_rotations.result.pair_is_inconsistent;
  is_beyond.Remove(by_rotations.pair_is_screened);
  return by_rotations;
}

RotationEstimate CorrectRotations(const ViewGraph& view_graph,
                                  const RotationEstimate& rotations,
                                  const PositionsByRotations& by_rotations,
                                  const Context& context) {
  const TranslationState& state = by_rotations.state;
  RotationEstimate corrected = rotations;
  corrected.rig_from_world =
      RefinePoseGraph({state.problem, state.pairs.baselines, state.pairs.scales,
                       state.initial, by_rotations.pair_is_screened},
                      view_graph, rotations, context)
          .rig_from_world;
  return corrected;
}

// Whether `rotations` turn steps of the sequence that the input rotations do
// not turn: a pose graph can tear a step that few pairs cross.
bool TurnsMoreSteps(const PositionInput& input,
                    const PairFilteringOptions& options,
                    const RotationEstimate& rotations) {
  const PairEvidence evidence =
      EvidenceOf(input, input.rotations.pair_is_inlier, options);
  return FindTurnedSteps(evidence, rotations).Count() >
         FindTurnedSteps(evidence, input.rotations).Count();
}

// Whether corrected rotations reduce the displacement of steps and place as
// many frames.
bool IsBetter(const PositionResult& corrected, const PositionResult& result) {
  return corrected.displacement < result.displacement &&
         corrected.summary.is_metric == result.summary.is_metric &&
         corrected.summary.num_frames_not_placed <=
             result.summary.num_frames_not_placed;
}

void LogCorrection(const PositionResult& corrected,
                   const PositionResult& result, const Context& context) {
  const auto describe = [](const PositionResult& r) {
    return std::to_string(r.summary.num_displaced_steps) +
           " steps of the sequence by " + std::to_string(r.displacement);
  };
  context.Debug("positions: loops displace " + describe(result) +
                "; with rotations corrected by a pose graph, they displace " +
                describe(corrected));
}

}  // namespace

PositionResult EstimatePositions(const PositionInput& input,
                                 const PositionOptions& options,
                                 const Context& context) {
  PositionsByRotations best =
      EstimateByRotations(kNonBilinearObjective, input, options, context);
  RotationEstimate rotations = input.rotations;
  for (int i = 0; i < kMaxNumCorrections && best.result.displacement > 0.0;
       ++i) {
    RotationEstimate corrected =
        CorrectRotations(input.view_graph, rotations, best, context);
    if (TurnsMoreSteps(input, options.filtering, corrected)) break;
    // The observer knows only the rotations of the input.
    PositionsByRotations next = EstimateByRotations(
        kNonBilinearObjective,
        {input.scene, input.bearings, input.view_graph, input.index, corrected,
         input.tracks, input.pair_on_path},
        options, context);
    LogCorrection(next.result, best.result, context);
    if (!IsBetter(next.result, best.result)) break;
    rotations = std::move(corrected);
    next.result.summary.num_rotation_corrections = i + 1;
    best = std::move(next);
    best.result.corrected_rig_from_world = rotations.rig_from_world;
  }
  return std::move(best.result);
}

PositionResult EstimatePositionsBy(const PositionObjective& objective,
                                   const PositionInput& input,
                                   const PositionOptions& options,
                                   const Context& context) {
  return EstimateByRotations(objective, input, options, context).result;
}

}  // namespace mgsfm

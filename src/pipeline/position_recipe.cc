// SPDX-License-Identifier: BSD-3-Clause
#include "pipeline/position_recipe.h"

#include <cstdio>
#include <limits>
#include <string>
#include <utility>
#include <vector>

#include "mgsfm/base/timer.h"
#include "pair_filtering/baseline_consistency.h"
#include "pair_filtering/displaced_steps.h"
#include "pair_filtering/skeletal_graph.h"
#include "pair_filtering/turned_steps.h"
#include "translation/measured_baselines.h"
#include "translation/pose_graph.h"

namespace mgsfm {
namespace {

// The positions of a skeleton only screen pairs, so their ADMM ends early. Half
// and twice the value change no error (docs/results/constants.md).
constexpr int kMaxNumSkeletonIterations = 60;

// A correction of rotations can leave a smaller displaced step; on the drives
// of docs/results/constants.md, the first leaves none.
constexpr int kMaxNumCorrections = 3;

// Logs the time of each step.
class StepLog {
 public:
  explicit StepLog(const Context& context) : context_(context) {}
  void Finish(const char* step) {
    char line[128];
    std::snprintf(line, sizeof(line), "positions: %s %.3f s", step,
                  timer_.Seconds());
    context_.Debug(line);
    timer_ = Timer();
  }

 private:
  const Context& context_;
  Timer timer_;
};

// The skeletal graph, and L1 positions by its pairs alone.
struct PositionSkeleton {
  Mask is_in_skeleton;
  InitialPositions initial;
};

BaselineComparison CompareMeasured(const PositionMeasurements& measured,
                                   const InitialPositions& initial,
                                   const Positions& positions) {
  return CompareWith(measured.problem, measured.pairs.baselines,
                     measured.pairs.scales, initial.group_factor, positions);
}

// Pairs beyond the drift bound of a skeleton.
Mask BeyondDrift(const PositionInput& input,
                 const PositionMeasurements& measured,
                 const PositionSkeleton& skeleton, double drift_bound,
                 const PairFilteringOptions& options) {
  const BaselineComparison by_skeleton =
      CompareMeasured(measured, skeleton.initial, skeleton.initial.positions);
  return FindInconsistentBaselines(
      input.index, input.view_graph, skeleton.is_in_skeleton,
      by_skeleton.measured, by_skeleton.centers, drift_bound, options);
}

PositionSkeleton FindSkeleton(const PositionInput& input,
                              const PositionMeasurements& measured,
                              const PositionOptions& options,
                              const Context& context) {
  Mask is_candidate(measured.pairs.baselines.size());
  for (size_t i = 0; i < is_candidate.size(); ++i) {
    is_candidate[i] =
        measured.pairs.baselines[i].kind == BaselineKind::kDirection;
  }
  Mask is_in_skeleton =
      SelectSkeletalGraph(input.index, input.view_graph, is_candidate,
                          options.filtering, context.num_threads);
  // Pairs without parallax also place the frames of the skeleton.
  Mask pair_is_used = is_in_skeleton;
  for (size_t i = 0; i < pair_is_used.size(); ++i) {
    if (measured.pairs.baselines[i].kind == BaselineKind::kNoParallax) {
      pair_is_used[i] = true;
    }
  }
  return {std::move(is_in_skeleton),
          InitializePositions(
              measured.problem, measured.pairs.baselines, measured.pairs.scales,
              pair_is_used, options.averaging.min_parallax_deg,
              {kMaxNumSkeletonIterations, kStartTolerance}, context)};
}

ScreenedPositions Initialize(const PositionMeasurements& measured,
                             Mask pair_is_used, const PositionOptions& options,
                             const InitializationOptions& initialization,
                             const Context& context) {
  InitialPositions initial = InitializePositions(
      measured.problem, measured.pairs.baselines, measured.pairs.scales,
      pair_is_used, options.averaging.min_parallax_deg, initialization,
      context);
  return {std::move(initial), std::move(pair_is_used)};
}

// Pairs whose baselines contradict positions in the unit of `initial`.
Mask FindInconsistent(const PositionInput& input,
                      const PositionMeasurements& measured,
                      const InitialPositions& initial,
                      const Positions& positions,
                      const PairFilteringOptions& options) {
  if (!options.use_baseline_consistency) {
    return Mask(input.view_graph.pairs.size(), false);
  }
  const BaselineComparison by_positions =
      CompareMeasured(measured, initial, positions);
  return FindInconsistentPairs(input.view_graph, by_positions.measured,
                               by_positions.centers, options);
}

// Per frame: the deviation of a displaced step to it, in the unit of measured
// lengths.
StepDeviations DisplacedSteps(const PositionInput& input,
                              const PositionMeasurements& measured,
                              const InitialPositions& initial,
                              const Positions& positions,
                              const PositionEstimate& estimate,
                              const PairFilteringOptions& options) {
  return FindDisplacedSteps(input.scene, input.index, input.view_graph,
                            input.rotations.pair_is_inlier,
                            CompareMeasured(measured, initial, positions),
                            estimate.frame_center_in_world, options);
}

void Observe(const PositionInput& input, const PositionMeasurements& measured,
             const Positions& positions) {
  if (!input.observer) return;
  input.observer(
      MakePositionEstimate(input.scene, measured.problem, positions, {}));
}

}  // namespace

PositionMeasurements MeasurePositions(const PositionInput& input,
                                      const PositionOptions& options,
                                      const Context& context) {
  PositionProblem problem = MakePositionProblem(input.scene, input.rotations);
  TrackRays rays = ComputeTrackRays(problem, input.bearings, input.tracks,
                                    context.num_threads);
  PairMeasurements pairs = MeasurePairs(
      input.scene, input.bearings, input.view_graph,
      input.rotations.pair_is_inlier, problem,
      options.averaging.min_parallax_deg, context, input.length_hints);
  return {std::move(problem), std::move(rays), std::move(pairs)};
}

ScreenedPositions ScreenAndInitialize(
    const PositionInput& input, const PositionMeasurements& measured,
    const PositionOptions& options, const InitializationOptions& initialization,
    const Context& context) {
  const PairFilteringOptions& filtering = options.filtering;
  const Mask& all = input.rotations.pair_is_inlier;
  if (!filtering.use_skeletal_graph || !filtering.use_baseline_drift_bound) {
    return Initialize(measured, all, options, initialization, context);
  }
  StepLog log(context);
  const PositionSkeleton skeleton =
      FindSkeleton(input, measured, options, context);
  const BaselineComparison by_skeleton =
      CompareMeasured(measured, skeleton.initial, skeleton.initial.positions);
  log.Finish("skeletal graph");
  ScreenedPositions best;
  int fewest_violated = std::numeric_limits<int>::max();
  for (const double drift_bound : BaselineDriftBounds(filtering)) {
    Mask pair_is_used = all;
    pair_is_used.Remove(
        BeyondDrift(input, measured, skeleton, drift_bound, filtering));
    ScreenedPositions screened = Initialize(measured, std::move(pair_is_used),
                                            options, initialization, context);
    const int num_violated = CountViolatedSkeletonEdges(
        input.view_graph, skeleton.is_in_skeleton, by_skeleton,
        CompareMeasured(measured, screened.initial, screened.initial.positions),
        filtering);
    context.Debug("positions: drift bound " + std::to_string(drift_bound) +
                  " violates " + std::to_string(num_violated) +
                  " skeleton edges");
    if (num_violated < fewest_violated) {
      fewest_violated = num_violated;
      best = std::move(screened);
    }
    if (num_violated == 0) break;
  }
  log.Finish("L1 positions");
  return best;
}

Mask KeepConsistentPairs(const PositionInput& input,
                         const PositionMeasurements& measured,
                         const ScreenedPositions& screened,
                         const Positions& positions,
                         const PairFilteringOptions& options) {
  Mask pair_is_used = screened.pair_is_used;
  pair_is_used.Remove(
      FindInconsistent(input, measured, screened.initial, positions, options));
  return pair_is_used;
}

PositionResult ConcludePositions(const PositionInput& input,
                                 const PositionMeasurements& measured,
                                 const RefinementInput& refinement,
                                 Positions positions, TrackPoints points,
                                 TranslationSummary summary,
                                 const PairFilteringOptions& options) {
  const InitialPositions& initial = refinement.initial;
  if (!initial.is_metric) {
    ScaleBy(FactorToMeasuredLengths(refinement, positions), &positions,
            &points);
  }
  PositionResult result;
  result.pair_is_inconsistent =
      FindInconsistent(input, measured, initial, positions, options);
  result.estimate =
      MakePositionEstimate(input.scene, measured.problem, positions, points);
  result.summary = std::move(summary);
  SummarizePairs(measured.pairs, input.rotations.pair_is_inlier,
                 &result.summary);
  result.summary.num_pairs_inconsistent_with_positions =
      static_cast<int>(result.pair_is_inconsistent.Count());
  for (const auto& deviation : DisplacedSteps(
           input, measured, initial, positions, result.estimate, options)) {
    if (!deviation) continue;
    ++result.summary.num_displaced_steps;
    result.displacement += deviation->norm();
  }
  result.summary.initialization = initial.solve;
  SummarizeEstimate(measured.problem, initial, result.estimate,
                    &result.summary);
  return result;
}

namespace {

// The results of one set of rotations.
struct PositionsByRotations {
  PositionProblem problem;
  PairMeasurements pairs;
  ScreenedPositions screened;
  PositionResult result;
};

PositionsByRotations EstimateByRotations(const PositionInput& input,
                                         const PositionOptions& options,
                                         const Context& context) {
  StepLog log(context);
  PositionMeasurements measured = MeasurePositions(input, options, context);
  log.Finish("baselines of pairs");

  InitializationOptions initialization;
  initialization.relative_tolerance = kStartTolerance;
  ScreenedPositions screened =
      ScreenAndInitialize(input, measured, options, initialization, context);
  log.Finish("screened L1 positions");
  Observe(input, measured, screened.initial.positions);

  const RefinedPositions by_pairs = RefineWithPairs(
      {measured.problem, measured.pairs.baselines, measured.pairs.scales,
       screened.initial, screened.pair_is_used},
      options.averaging, context);
  log.Finish("refinement with pairs");
  Observe(input, measured, by_pairs.positions);

  const Mask pair_is_used = KeepConsistentPairs(
      input, measured, screened, by_pairs.positions, options.filtering);
  const RefinementInput refinement{measured.problem, measured.pairs.baselines,
                                   measured.pairs.scales, screened.initial,
                                   pair_is_used};
  TrackRefinement by_tracks =
      RefineWithTracks(refinement, by_pairs.positions, measured.rays,
                       options.averaging, context);
  log.Finish("refinement with tracks");

  TranslationSummary summary;
  summary.camera_refinement = by_pairs.solve;
  summary.joint_refinement = by_tracks.solve;
  summary.num_frames_placed_by_points = by_tracks.num_frames_placed_by_points;
  PositionResult result = ConcludePositions(
      input, measured, refinement, std::move(by_tracks.positions),
      std::move(by_tracks.points), std::move(summary), options.filtering);
  return {std::move(measured.problem), std::move(measured.pairs),
          std::move(screened), std::move(result)};
}

RotationEstimate CorrectRotations(const ViewGraph& view_graph,
                                  const RotationEstimate& rotations,
                                  const PositionsByRotations& by_rotations,
                                  const Context& context) {
  const ScreenedPositions& screened = by_rotations.screened;
  RotationEstimate corrected = rotations;
  corrected.rig_from_world =
      RefinePoseGraph(
          {by_rotations.problem, by_rotations.pairs.baselines,
           by_rotations.pairs.scales, screened.initial, screened.pair_is_used},
          view_graph, rotations, context)
          .rig_from_world;
  return corrected;
}

// Whether rotations turn steps of the sequence that the rotations of the input
// do not: a pose graph can tear a step that few pairs cross.
bool TurnsMoreSteps(const PositionInput& input,
                    const RotationEstimate& rotations) {
  const auto count = [&](const RotationEstimate& r) {
    return FindTurnedSteps(input.scene, input.index, input.view_graph,
                           input.rotations.pair_is_inlier, r)
        .Count();
  };
  return count(rotations) > count(input.rotations);
}

// Whether corrected rotations displace steps less and place as many frames.
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
  PositionsByRotations best = EstimateByRotations(input, options, context);
  RotationEstimate rotations = input.rotations;
  for (int i = 0; i < kMaxNumCorrections && best.result.displacement > 0.0;
       ++i) {
    RotationEstimate corrected =
        CorrectRotations(input.view_graph, rotations, best, context);
    if (TurnsMoreSteps(input, corrected)) break;
    // The observer knows only the rotations of the input.
    PositionsByRotations next = EstimateByRotations(
        {input.scene, input.bearings, input.view_graph, input.index, corrected,
         input.tracks, input.length_hints},
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

}  // namespace mgsfm

// SPDX-License-Identifier: BSD-3-Clause
#include "mgsfm/translation/translation_averaging.h"

#include <utility>

#include "mgsfm/base/error.h"
#include "translation/translation_stages.h"

namespace mgsfm {

TranslationResult AverageTranslations(
    const Scene& scene, const Bearings& bearings, const ViewGraph& view_graph,
    const RotationEstimate& rotations, const ObservationGroups& tracks,
    const TranslationAveragingOptions& options, const Context& context) {
  MGSFM_CHECK_EQ(rotations.pair_is_inlier.size(), view_graph.pairs.size());
  MGSFM_CHECK_EQ(rotations.rig_from_world.size(), scene.frames.size());
  MGSFM_CHECK_EQ(bearings.images.size(), scene.images.size());
  const PositionProblem problem = MakePositionProblem(scene, rotations);
  const TrackRays rays =
      ComputeTrackRays(problem, bearings, tracks, context.num_threads);
  const Mask& pair_is_used = rotations.pair_is_inlier;
  const PairMeasurements pairs =
      MeasurePairs(scene, bearings, view_graph, pair_is_used, problem,
                   options.min_parallax_deg, context);
  InitializationOptions initialization;
  initialization.relative_tolerance = kStartTolerance;
  const InitialPositions initial =
      InitializePositions(problem, pairs.baselines, pairs.scales, pair_is_used,
                          options.min_parallax_deg, initialization, context);
  const RefinementInput input{problem, pairs.baselines, pairs.scales, initial,
                              pair_is_used};
  RefinedPositions cameras = RefineWithPairs(input, options, context);
  TrackRefinement refined =
      RefineWithTracks(input, cameras.positions, rays, options, context);
  if (!initial.is_metric) {
    ScaleBy(FactorToMeasuredLengths(input, refined.positions),
            &refined.positions, &refined.points);
  }

  TranslationResult result;
  result.estimate =
      MakePositionEstimate(scene, problem, refined.positions, refined.points);
  TranslationSummary& summary = result.summary;
  SummarizePairs(pairs, pair_is_used, &summary);
  SummarizeEstimate(problem, initial, result.estimate, &summary);
  summary.initialization = initial.solve;
  summary.camera_refinement = std::move(cameras.solve);
  summary.joint_refinement = std::move(refined.solve);
  summary.num_frames_placed_by_points = refined.num_frames_placed_by_points;
  return result;
}

}  // namespace mgsfm

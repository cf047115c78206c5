// SPDX-License-Identifier: BSD-3-Clause
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "base/ranges.h"
#include "mapper/components.h"
#include "mapper/mapper_recipe.h"
#include "mapper/model_adjustment.h"
#include "mapper/model_extension.h"
#include "mapper/pair_judgement.h"
#include "mapper/stage.h"
#include "mapper/weak_seams.h"
#include "mgsfm/base/mask.h"
#include "mgsfm/incremental/incremental_mapping.h"
#include "mgsfm/pair_filtering/pair_filtering.h"
#include "pair_filtering/frame_pair_index.h"
#include "registration/known_lengths.h"

namespace mgsfm {
namespace {

IncrementalResult Grow(const MapperRunInput& run, const VerifiedPairs& pairs,
                       const Mask& pair_is_used,
                       const Mask& pair_is_of_neighbors,
                       std::vector<StageTime>* times) {
  const RunningStage stage("incremental mapping", run.context);
  IncrementalResult grown = MapIncrementally(
      {run.scene, pairs.bearings, pairs.view_graph, pair_is_used,
       pair_is_of_neighbors},
      {run.options.extension.resection, run.options.bundle_adjustment,
       run.options.tracks, run.options.match_selection,
       run.options.min_num_frames},
      stage.context(), run.input.observer);
  stage.Finish(times);
  return grown;
}

// The pairs of a run and what the rules say about them.
struct Evidence {
  const VerifiedPairs& pairs;
  const FramePairIndex& index;
  const JudgedPairs& judged;
  const Mask& pair_is_used;
};

// The final adjustment of a model that has grown, and its seams.
std::vector<MapperModel> Finish(const MapperRunInput& run,
                                const Evidence& evidence,
                                SharedCalibration* calibration,
                                MapperModel model, Reconstruction initial) {
  const VerifiedPairs& pairs = evidence.pairs;
  AdjustmentInput input{
      run.scene, pairs.view_graph, pairs.matches(), run.input.position_priors,
      evidence.judged.rotations.gravity_rejection ? kNoGravity
                                                  : run.input.gravity_priors};
  input.pair_is_used = evidence.pair_is_used;
  input.is_metric = model.translation.is_metric;
  input.observer = run.input.observer;
  input.calibration = calibration;
  AdjustModel(input, run.options, run.context, std::move(initial), &model);
  if (run.options.is_for_lenses) return {std::move(model)};
  return TestSeams(evidence.index, evidence.judged.motion.pair_on_path,
                   run.options, run.context, std::move(input),
                   std::move(model));
}

// The rotations of a model, and the pairs that agree with it: the input of the
// checks that follow averaging.
RotationEstimate RotationsOf(const MapperRunInput& run,
                             const Evidence& evidence,
                             const Reconstruction& model) {
  const auto rotation_of = [](const std::optional<Rigid3>& pose) {
    return pose ? std::optional(pose->rotation) : std::nullopt;
  };
  RotationEstimate rotations;
  for (const auto& pose : model.rig_from_world) {
    rotations.rig_from_world.push_back(rotation_of(pose));
  }
  for (const auto& pose : model.sensor_from_rig) {
    rotations.sensor_from_rig.push_back(rotation_of(pose));
  }
  rotations.pair_is_inlier =
      SelectConsistentMatches(
          {run.scene, evidence.pairs.view_graph, evidence.pair_is_used, model},
          run.options.bundle_adjustment.max_max_error_px,
          run.options.match_selection, run.context)
          .pair_is_used;
  return rotations;
}

void ListReasons(const MapperRunInput& run, const IncrementalResult& grown,
                 const Mask& is_in_small_model, MapperResult* result) {
  std::vector<std::string> reasons(run.scene.frames.size(),
                                   "too few points constrain its position");
  for (const ResectedFrame& frame : grown.rejected) {
    reasons[frame.frame_idx] =
        ReasonForRejection(frame, run.options.extension.resection);
  }
  for (size_t i = 0; i < reasons.size(); ++i) {
    if (IsInModel(result->models, i)) continue;
    if (is_in_small_model[i]) {
      reasons[i] = "its model has fewer than " +
                   std::to_string(run.options.min_model_size) + " images";
    }
    result->unregistered_frames.push_back({static_cast<int>(i), reasons[i]});
  }
}

// The finished models of one that has grown.
std::vector<MapperModel> FinishModel(const MapperRunInput& run,
                                     const Evidence& evidence,
                                     const IncrementalSummary& growth,
                                     SharedCalibration* calibration,
                                     Reconstruction initial,
                                     MapperResult* result) {
  const Scene& scene = run.scene;
  MapperModel model;
  model.tracks = growth.tracks;
  model.translation.is_metric = AnyOf(scene.sensors, HasKnownLength);
  result->rotation.sensors.clear();
  model.reconstruction.sensor_from_rig = initial.sensor_from_rig;
  Reconstruction no_start;
  no_start.sensor_from_rig.resize(scene.sensors.size());
  DescribeSensors(scene, no_start, growth.placed_sensors, &model, result);
  model.num_frames_in_component =
      static_cast<int>(FramesWith(initial.rig_from_world).Count());
  model.rejected_groups = FindRejectedGroups(
      evidence.pairs, evidence.index, RotationsOf(run, evidence, initial),
      Mask(evidence.pair_is_used.size()), evidence.judged.rotations.verdicts,
      run.context);
  return Finish(run, evidence, calibration, std::move(model),
                std::move(initial));
}

void MapByGrowth(const MapperRunInput& run, VerifiedPairs* pairs,
                 MapperResult* result) {
  const FramePairIndex index(run.scene, pairs->view_graph,
                             run.options.pair_filtering.is_sequence);
  JudgedPairs judged = JudgePairs(run, index, nullptr, pairs, &result->times);
  RejectByPositions(run, *pairs, index, &judged, &result->times);
  const Mask pair_is_used = UsablePairs(judged.rotations.verdicts);
  IncrementalResult grown = Grow(run, *pairs, pair_is_used,
                                 FindPairsOfNeighbors(index), &result->times);
  SharedCalibration calibration(run.scene, run.lenses);
  for (Reconstruction& initial : grown.estimate) {
    if (!result->models.empty()) {
      PassOn(result->models.back(), run.input.position_priors, run.options,
             run.context, &calibration);
    }
    for (MapperModel& finished :
         FinishModel(run, {*pairs, index, judged, pair_is_used}, grown.summary,
                     &calibration, std::move(initial), result)) {
      if (!IsLargeEnough(finished, run.options)) continue;
      result->models.push_back(std::move(finished));
    }
  }
  result->rejected_pairs =
      CountRejections(judged.rotations.verdicts, pairs->num_of_fixed_regions);
  result->incremental = std::move(grown.summary);
  ListReasons(run, grown,
              KeepLargeModels(run.scene, run.options, &result->models), result);
}

}  // namespace

MapperResult RunIncrementalMapper(const MapperInput& input,
                                  const MapperOptions& options,
                                  const Context& context) {
  return RunMapperBy(MapByGrowth, input, options, context);
}

}  // namespace mgsfm

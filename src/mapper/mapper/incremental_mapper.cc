// SPDX-License-Identifier: BSD-3-Clause
#include "mapper/incremental_mapper.h"

#include <algorithm>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "mapper/components.h"
#include "mapper/mapper_recipe.h"
#include "mapper/model_adjustment.h"
#include "mapper/model_extension.h"
#include "mapper/stage.h"
#include "mapper/weak_seams.h"
#include "mgsfm/base/mask.h"
#include "mgsfm/incremental/incremental_mapping.h"
#include "mgsfm/pair_filtering/pair_filtering.h"
#include "pair_filtering/frame_pair_index.h"
#include "registration/frame_addition.h"

namespace mgsfm {
namespace {

IncrementalResult Grow(const MapperRunInput& run, const VerifiedPairs& pairs,
                       std::vector<StageTime>* times) {
  const RunningStage stage("incremental mapping", run.context);
  IncrementalResult grown = MapIncrementally(
      {run.scene, pairs.bearings, pairs.view_graph},
      {run.options.extension.resection, run.options.bundle_adjustment,
       run.options.tracks, run.options.match_selection,
       run.options.min_num_frames},
      run.context, run.input.observer);
  stage.Finish(times);
  return grown;
}

// The final adjustment of a model that has grown, and its seams.
std::vector<MapperModel> Finish(const MapperRunInput& run,
                                const VerifiedPairs& pairs,
                                const FramePairIndex& index,
                                SharedCalibration* calibration,
                                MapperModel model, Reconstruction initial) {
  AdjustmentInput input{run.scene, pairs.view_graph, pairs.matches(),
                        run.input.position_priors, run.input.gravity_priors};
  input.pair_is_used.assign(pairs.view_graph.pairs.size(), true);
  input.is_metric = model.translation.is_metric;
  input.observer = run.input.observer;
  input.calibration = calibration;
  AdjustModel(input, run.options, run.context, std::move(initial), &model);
  if (run.options.is_for_lenses) return {std::move(model)};
  const std::vector<std::optional<Rigid3>> no_path(
      pairs.view_graph.pairs.size());
  return TestSeams(index, no_path, run.options, run.context, std::move(input),
                   std::move(model));
}

// The rotations of a model, and the pairs that agree with it: the input of the
// checks that follow averaging.
RotationEstimate RotationsOf(const MapperRunInput& run,
                             const VerifiedPairs& pairs,
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
  const Mask all_pairs(pairs.view_graph.pairs.size(), true);
  rotations.pair_is_inlier =
      SelectConsistentMatches({run.scene, pairs.view_graph, all_pairs, model},
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

void MapByGrowth(const MapperRunInput& run, VerifiedPairs* pairs,
                 MapperResult* result) {
  const Scene& scene = run.scene;
  IncrementalResult grown = Grow(run, *pairs, &result->times);
  const bool is_metric =
      std::any_of(scene.sensors.begin(), scene.sensors.end(), HasKnownLength);
  const FramePairIndex index(scene, pairs->view_graph,
                             run.options.pair_filtering.is_sequence);
  SharedCalibration calibration(scene, run.lenses);
  Reconstruction no_start;
  no_start.sensor_from_rig.resize(scene.sensors.size());
  for (Reconstruction& initial : grown.estimate) {
    if (!result->models.empty()) {
      PassOn(result->models.back(), run.input.position_priors, run.options,
             run.context, &calibration);
    }
    MapperModel model;
    model.tracks = grown.summary.tracks;
    model.translation.is_metric = is_metric;
    result->rotation.sensors.clear();
    model.reconstruction.sensor_from_rig = initial.sensor_from_rig;
    DescribeSensors(scene, no_start, grown.summary.placed_sensors, &model,
                    result);
    model.num_frames_in_component =
        static_cast<int>(FramesWith(initial.rig_from_world).Count());
    model.rejected_groups = FindRejectedGroups(
        *pairs, index, RotationsOf(run, *pairs, initial),
        Mask(pairs->view_graph.pairs.size()),
        PairVerdicts(pairs->view_graph.pairs.size()), run.context);
    for (MapperModel& finished : Finish(run, *pairs, index, &calibration,
                                        std::move(model), std::move(initial))) {
      if (!IsLargeEnough(finished, run.options)) continue;
      result->models.push_back(std::move(finished));
    }
  }
  result->incremental = std::move(grown.summary);
  ListReasons(run, grown, KeepLargeModels(scene, run.options, &result->models),
              result);
}

}  // namespace

MapperResult RunIncrementalMapper(const MapperInput& input,
                                  const MapperOptions& options,
                                  const Context& context) {
  return RunMapperBy(MapByGrowth, input, options, context);
}

}  // namespace mgsfm

// SPDX-License-Identifier: BSD-3-Clause
#include "mgsfm/mapper/mapper.h"

#include <algorithm>
#include <utility>

#include "input_check/known_rigs.h"
#include "mapper/components.h"
#include "mapper/input_check.h"
#include "mapper/lens_calibration.h"
#include "mapper/mapper_recipe.h"
#include "mapper/metric_scale.h"
#include "mapper/model_adjustment.h"
#include "mapper/model_extension.h"
#include "mapper/stage.h"
#include "mapper/unknown_lenses.h"
#include "mapper/verified_pairs.h"
#include "mapper/weak_seams.h"
#include "mgsfm/base/mask.h"
#include "moving_objects/moving_objects.h"
#include "pair_filtering/frame_pair_index.h"
#include "rotation_averaging/rotation_estimation.h"
#include "translation_averaging/position_estimation.h"

namespace mgsfm {
namespace {

// The inputs of a run. Runs with a subset of the pairs calibrate lenses.
struct Run {
  const PositionStep& estimate_positions;
  const MapperInput& input;  // beside scene and pairs
  const Scene& scene;        // with the lenses to start from
  const ViewGraph& matches;
  const CalibrationPrior& lenses;
  const MapperOptions& options;
  const Context& context;
};

// The results of the stages for the whole scene.
struct Measured {
  const VerifiedPairs& pairs;
  const FramePairIndex& index;
  const GravityPriors& gravity;
  const MotionOfScene& motion;
  PairVerdicts* verdicts;
  SharedCalibration* calibration;
};

// ---------------------------------------------------------------- 3. Rotations

EstimatedRotations AverageAllRotations(const Run& run,
                                       const RotationInput& input,
                                       std::vector<StageTime>* times) {
  const RunningStage stage("rotation averaging", run.context);
  EstimatedRotations rotations = EstimateRotations(
      input, {run.options.rotation_averaging, run.options.pair_filtering},
      run.context);
  stage.Finish(times);
  return rotations;
}

// ----------------------------------------------------------- 4. Moving objects

// Where objects move along with the rig, the matches of the static scene
// replace those of the view graph, and rotations are averaged again.
MotionOfScene RemoveMovingObjects(const Run& run, const FramePairIndex& index,
                                  VerifiedPairs* pairs,
                                  EstimatedRotations* rotations,
                                  std::vector<StageTime>* times) {
  const MapperOptions& options = run.options;
  if (!index.is_sequence() || !IsRuleOn(RejectionReason::kDiscontinuousMotion,
                                        options.pair_filtering)) {
    return {};
  }
  const RunningStage stage("moving objects", run.context);
  MotionOfScene motion =
      FindMovingObjects({run.scene, pairs->bearings, index, pairs->view_graph,
                         pairs->matches(), rotations->estimate},
                        {options.translation_averaging.min_parallax_deg,
                         options.view_graph, options.pair_filtering},
                        run.context);
  stage.Finish(times);
  if (motion.verdicts.empty()) return {};
  UseStaticPairs(run.context, &motion, pairs);
  *rotations = AverageAllRotations(run,
                                   {run.scene, pairs->view_graph, index,
                                    run.input.gravity_priors, motion.verdicts},
                                   times);
  return motion;
}

// ------------------------------------------------------------------- 5. Tracks

ObservationGroups EstablishAllTracks(const Run& run, const Measured& measured,
                                     const RotationEstimate& rotations,
                                     MapperModel* model) {
  const RunningStage stage("tracks", run.context);
  TrackResult tracks = EstablishTracks(run.scene, measured.pairs.view_graph,
                                       rotations.pair_is_inlier,
                                       run.options.tracks, run.context);
  stage.Finish(&model->times);
  model->tracks = tracks.summary;
  return std::move(tracks.estimate);
}

// ---------------------------------------------------------------- 6. Positions

// Sensors with baselines determined by earlier models are known.
PositionResult PlaceComponent(const Run& run, const Measured& measured,
                              const RotationEstimate& rotations,
                              const ObservationGroups& tracks,
                              MapperModel* model) {
  const RunningStage stage("translation averaging", run.context);
  const CalibrationPrior prior =
      measured.calibration->PriorFor(FramesWith(rotations.rig_from_world));
  const bool has_length = HasLength(prior);
  const Scene& scene = run.scene;
  const Scene with_rig = has_length ? WithKnownSensors(scene, prior) : Scene();
  PositionInput input{has_length ? with_rig : scene,
                      measured.pairs.bearings,
                      measured.pairs.view_graph,
                      measured.index,
                      rotations,
                      tracks,
                      &measured.motion.pair_on_path};
  if (const ModelObserver& observer = run.input.observer) {
    input.observer = [&](const PositionEstimate& positions) {
      observer(JoinEstimates(scene, rotations, positions, {}));
    };
  }
  PositionResult positions = run.estimate_positions(
      input, {run.options.translation_averaging, run.options.pair_filtering},
      run.context);
  stage.Finish(&model->times);
  model->translation = std::move(positions.summary);
  if (has_length) {
    model->translation.is_metric &=
        std::any_of(scene.sensors.begin(), scene.sensors.end(), HasKnownLength);
  }
  Reject(positions.pair_is_beyond_drift_bound,
         RejectionReason::kBaselineBeyondDriftBound, measured.verdicts);
  Reject(positions.pair_is_inconsistent, RejectionReason::kInconsistentBaseline,
         measured.verdicts);
  return positions;
}

// ---------------------------------------------- 7. Bundle adjustment and seams

// From rotations to an adjusted model, or to several if it is split at seams.
std::vector<MapperModel> MapComponent(const Run& run, const Measured& measured,
                                      RotationEstimate rotations) {
  MapperModel model;
  const ObservationGroups tracks =
      EstablishAllTracks(run, measured, rotations, &model);
  PositionResult positions =
      PlaceComponent(run, measured, rotations, tracks, &model);
  if (positions.corrected_rig_from_world) {
    rotations.rig_from_world = *std::move(positions.corrected_rig_from_world);
  }
  model.rejected_groups = FindRejectedGroups(
      measured.pairs, measured.index, rotations, positions.pair_is_inconsistent,
      *measured.verdicts, run.context);
  AdjustmentInput input{run.scene, measured.pairs.view_graph,
                        measured.pairs.matches(), run.input.position_priors,
                        measured.gravity};
  // Neither wrong matches nor duplicate structures may merge different points.
  input.pair_is_used = rotations.pair_is_inlier;
  input.pair_is_used.Remove(positions.pair_is_inconsistent);
  input.is_metric = model.translation.is_metric;
  input.observer = run.input.observer;
  input.calibration = measured.calibration;
  Reconstruction initial =
      JoinEstimates(run.scene, rotations, positions.estimate, tracks);
  if (input.observer) input.observer(initial);
  AdjustModel(input, run.options, run.context, std::move(initial), &model);
  if (run.options.is_for_lenses) return {std::move(model)};
  return TestSeams(measured.index, measured.motion.pair_on_path, run.options,
                   run.context, std::move(input), std::move(model));
}

// ------------------------------------------------------------------- 8. Models

// Each component uses the calibration of earlier components.
std::vector<MapperModel> MapComponents(const Run& run, const Measured& measured,
                                       const RotationEstimate& rotations) {
  const MapperOptions& options = run.options;
  const std::vector<int> num_frames = CountFramesOfComponents(rotations);
  std::vector<MapperModel> models;
  size_t num_learned = 0;
  for (size_t k = 0; k < num_frames.size(); ++k) {
    if (num_frames[k] < options.min_num_frames) continue;
    for (; num_learned < models.size(); ++num_learned) {
      measured.calibration->Learn(models[num_learned],
                                  run.input.position_priors,
                                  options.bundle_adjustment, run.context);
    }
    run.context.Info("component " + std::to_string(k) + ": " +
                     std::to_string(num_frames[k]) + " frames");
    for (MapperModel& model : MapComponent(
             run, measured,
             SelectComponent(measured.pairs, rotations, static_cast<int>(k)))) {
      if (!IsLargeEnough(model, options)) continue;
      model.num_frames_in_component = num_frames[k];
      models.push_back(std::move(model));
    }
  }
  return models;
}

void MapVerifiedPairs(const Run& run, VerifiedPairs* pairs,
                      MapperResult* result) {
  const FramePairIndex index(run.scene, pairs->view_graph,
                             run.options.pair_filtering.is_sequence);
  EstimatedRotations rotations = AverageAllRotations(
      run, {run.scene, pairs->view_graph, index, run.input.gravity_priors},
      &result->times);
  const MotionOfScene motion =
      RemoveMovingObjects(run, index, pairs, &rotations, &result->times);
  SharedCalibration calibration(run.scene, run.lenses);
  const bool has_gravity = !rotations.gravity_rejection;
  const Measured measured{*pairs,
                          index,
                          has_gravity ? run.input.gravity_priors : kNoGravity,
                          motion,
                          &rotations.verdicts,
                          &calibration};
  result->models = MapComponents(run, measured, rotations.estimate);
  result->rejected_pairs =
      CountRejections(rotations.verdicts, pairs->num_of_fixed_regions);
  KeepLargeModels(run.scene, rotations, motion.frame_is_ambiguous, run.options,
                  result);
  result->rotation = std::move(rotations.summary);
  result->gravity_rejection = std::move(rotations.gravity_rejection);
}

// ---------------------------------------------------- 1. Lenses, 2. View graph

// Calibrates lenses without the checks of the input, which wrong lenses
// mislead.
MapperResult MapScene(const Run& run) {
  MapperResult result;
  VerifiedPairs pairs =
      VerifyAllPairs(run.scene, run.matches, run.options, run.context, &result);
  const bool is_checked = !run.options.is_for_lenses;
  if (is_checked) CheckKnownRigs(run.scene, pairs.view_graph);
  if (run.input.existing_model) {
    ExtendModel(pairs, run.input, run.options, run.context, &result);
  } else {
    MapVerifiedPairs(run, &pairs, &result);
  }
  if (!is_checked) return result;
  const RunningStage stage("input check", run.context);
  CheckInput(pairs, run.input, run.options, run.context, &result);
  stage.Finish(&result.times);
  return result;
}

}  // namespace

MapperResult RunMapper(const MapperInput& input, const MapperOptions& options,
                       const Context& context) {
  return RunMapperWith(EstimatePositions, input, options, context);
}

MapperResult RunMapperWith(const PositionStep& estimate_positions,
                           const MapperInput& input,
                           const MapperOptions& options,
                           const Context& context) {
  (void)ParseMetricScale(options.metric_scale, input.scene);  // may throw
  const MapperInput no_priors;
  const SceneMapper map = [&](const Scene& scene, const ViewGraph& matches,
                              const CalibrationPrior& lenses,
                              const MapperOptions& of_round,
                              const Context& context_of_round) {
    return MapScene({estimate_positions,
                     of_round.is_for_lenses ? no_priors : input, scene, matches,
                     lenses, of_round, context_of_round});
  };
  MapperResult result =
      NeedsLenses(input.scene, options)
          ? MapWithUnknownLenses(input, map, options, context)
          : map(input.scene, input.view_graph, {}, options, context);
  AddUncertainFocalLengths(input.scene, &result);
  LogFindings(result, context);
  return result;
}

}  // namespace mgsfm

// SPDX-License-Identifier: BSD-3-Clause
#include "mgsfm/mapper/mapper.h"

#include <algorithm>
#include <optional>
#include <utility>
#include <vector>

#include "base/ranges.h"
#include "georegistration/world_frame.h"
#include "input_check/known_rigs.h"
#include "lenses/lens_calibration.h"
#include "mapper/components.h"
#include "mapper/input_check.h"
#include "mapper/mapper_recipe.h"
#include "mapper/model_adjustment.h"
#include "mapper/model_extension.h"
#include "mapper/pair_judgement.h"
#include "mapper/stage.h"
#include "mapper/verified_pairs.h"
#include "mapper/weak_seams.h"
#include "mgsfm/base/context.h"
#include "mgsfm/base/mask.h"
#include "mgsfm/bundle_adjustment/bundle_adjustment.h"
#include "mgsfm/scene/scene.h"
#include "mgsfm/scene/view_graph.h"
#include "moving_objects/moving_objects.h"
#include "pair_filtering/frame_pair_index.h"
#include "registration/known_lengths.h"
#include "rotation_averaging/rotation_estimation.h"
#include "translation_averaging/position_estimation.h"

namespace mgsfm {
namespace {

using Run = MapperRunInput;

// The results of the stages for the whole scene.
struct Measured {
  const PositionStep& estimate_positions;
  const VerifiedPairs& pairs;
  const FramePairIndex& index;
  const GravityPriors& gravity;
  const MotionOfScene& motion;
  PairVerdicts* verdicts;
  SharedCalibration* calibration;
};

// ------------------------------------------- 3. Rotations, 4. Moving objects

EstimatedRotations AverageAll(const Run& run, const ViewGraph& view_graph,
                              const FramePairIndex& index,
                              const PairVerdicts& verdicts,
                              std::vector<StageTime>* times) {
  const RunningStage stage("rotation averaging", run.context);
  EstimatedRotations rotations = EstimateRotations(
      {run.scene, view_graph, index, run.input.gravity_priors, verdicts},
      {run.options.rotation_averaging, run.options.pair_filtering},
      stage.context());
  stage.Finish(times);
  return rotations;
}

}  // namespace

JudgedPairs JudgePairs(const Run& run, const FramePairIndex& index,
                       const Mask* frames_with_objects, VerifiedPairs* pairs,
                       std::vector<StageTime>* times) {
  JudgedPairs judged;
  judged.rotations = AverageAll(run, pairs->view_graph, index, {}, times);
  judged.motion = RemoveMovingObjects(run, index, frames_with_objects,
                                      judged.rotations.estimate, pairs, times);
  if (!judged.motion.verdicts.empty()) {
    judged.rotations = AverageAll(run, pairs->view_graph, index,
                                  judged.motion.verdicts, times);
  }
  return judged;
}

Mask UsablePairs(const PairVerdicts& verdicts) {
  Mask is_usable(verdicts.size());
  for (size_t i = 0; i < verdicts.size(); ++i) {
    const auto& verdict = verdicts[i];
    is_usable[i] = !verdict ||
                   verdict == RejectionReason::kUnknownSensorRotation ||
                   verdict == RejectionReason::kFrameWithoutRotation ||
                   verdict == RejectionReason::kDifferentComponents;
  }
  return is_usable;
}

namespace {

// ---------------------------------------------------------------- 6. Positions

// Sensors with baselines determined by earlier models are known.
PositionResult PlaceComponent(const Run& run, const Measured& measured,
                              const RotationEstimate& rotations,
                              const ObservationGroups& tracks,
                              MapperModel* model) {
  const RunningStage stage("translation averaging", run.context);
  const CalibrationPrior prior =
      measured.calibration->PriorFor(FramesWith(rotations.rig_from_world));
  const Scene& scene = run.scene;
  const std::optional<Scene> with_rig = WithKnownSensors(scene, prior);
  PositionInput input{with_rig ? *with_rig : scene,
                      measured.pairs.bearings,
                      measured.pairs.view_graph,
                      measured.index,
                      rotations,
                      tracks,
                      &measured.motion.pair_on_path};
  if (const ModelObserver& observer = run.input.observer) {
    input.observer = [&](const PositionEstimate& positions) {
      observer(JoinEstimates(scene, rotations, positions, tracks));
    };
  }
  PositionResult positions = measured.estimate_positions(
      input, {run.options.translation_averaging, run.options.pair_filtering},
      stage.context());
  stage.Finish(&model->times);
  model->translation = std::move(positions.summary);
  if (with_rig) {
    model->translation.is_metric &= AnyOf(scene.sensors, HasKnownLength);
  }
  Reject(positions.pair_is_beyond_drift_bound,
         RejectionReason::kBaselineBeyondDriftBound, measured.verdicts);
  Reject(positions.pair_is_inconsistent, RejectionReason::kInconsistentBaseline,
         measured.verdicts);
  return positions;
}

// ----------------------------------- 5. Tracks, 7. Bundle adjustment and seams

// From rotations to an adjusted model, or to several if it is split at seams.
std::vector<MapperModel> MapComponent(const Run& run, const Measured& measured,
                                      RotationEstimate rotations) {
  MapperModel model;
  const RunningStage stage("tracks", run.context);
  const TrackResult tracks = EstablishTracks(
      run.scene, measured.pairs.view_graph, rotations.pair_is_inlier,
      run.options.tracks, stage.context());
  stage.Finish(&model.times);
  model.tracks = tracks.summary;
  PositionResult positions =
      PlaceComponent(run, measured, rotations, tracks.estimate, &model);
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
      JoinEstimates(run.scene, rotations, positions.estimate, tracks.estimate);
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
      PassOn(models[num_learned], run.input.position_priors, options,
             run.context, measured.calibration);
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

void MapVerifiedPairs(const PositionStep& estimate_positions, const Run& run,
                      VerifiedPairs* pairs, MapperResult* result) {
  const FramePairIndex index(run.scene, pairs->view_graph,
                             run.options.pair_filtering.is_sequence);
  auto [rotations, motion] =
      JudgePairs(run, index, nullptr, pairs, &result->times);
  SharedCalibration calibration(run.scene, run.lenses);
  const Measured measured{
      estimate_positions,
      *pairs,
      index,
      rotations.gravity_rejection ? kNoGravity : run.input.gravity_priors,
      motion,
      &rotations.verdicts,
      &calibration};
  result->models = MapComponents(run, measured, rotations.estimate);
  result->rejected_pairs =
      CountRejections(rotations.verdicts, pairs->num_of_fixed_regions);
  const Mask is_in_small_model =
      KeepLargeModels(run.scene, run.options, &result->models);
  ListUnregistered(run.scene, rotations, motion.frame_is_ambiguous,
                   is_in_small_model, run.options, result);
  result->rotation = std::move(rotations.summary);
  result->gravity_rejection = std::move(rotations.gravity_rejection);
}

// ---------------------------------------------------- 1. Lenses, 2. View graph

// Calibrates lenses without the checks of the input, which wrong lenses
// mislead.
MapperResult MapOnce(const PairStep& map_pairs, const Run& run) {
  MapperResult result;
  const std::optional<PairsOfExtension> selected = SelectPairsOfExtension(run);
  VerifiedPairs pairs =
      VerifyAllPairs(run.scene, selected ? selected->matches : run.matches,
                     run.options, run.context, &result);
  const bool is_checked = !run.options.is_for_lenses;
  if (is_checked) {
    CheckKnownRigs(run.scene, {pairs.bearings, pairs.view_graph});
  }
  if (run.input.existing_model) {
    ExtendModel(run, selected ? &*selected : nullptr, &pairs, &result);
  } else {
    map_pairs(run, &pairs, &result);
  }
  if (!is_checked) return result;
  const RunningStage stage("input check", run.context);
  CheckInput(pairs, run.input, run.options, stage.context(), &result);
  stage.Finish(&result.times);
  return result;
}

// Uses priors unless it calibrates lenses. Expected motions that the joint
// model refutes reject no pairs.
MapperResult MapScene(const PairStep& map_pairs, const Run& requested) {
  const MapperInput no_priors;
  const Run run{requested.options.is_for_lenses ? no_priors : requested.input,
                requested.scene,
                requested.matches,
                requested.lenses,
                requested.options,
                requested.context};
  MapperResult result = MapOnce(map_pairs, run);
  if (result.models.empty() || !result.models.front().refutes_motion) {
    return result;
  }
  run.context.Info(
      "the model contradicts most motions that motion continuity expects next "
      "to moving objects; the scene is mapped again without this rule");
  MapperOptions options = run.options;
  options.pair_filtering.use_motion_continuity = false;
  MapperResult without = MapOnce(map_pairs, {run.input, run.scene, run.matches,
                                             run.lenses, options, run.context});
  if (without.models.empty()) return result;
  without.motion_was_refuted = true;
  std::vector<StageTime>& times = result.times;
  for (const MapperModel& model : result.models) {
    times.insert(times.end(), model.times.begin(), model.times.end());
  }
  without.times.insert(without.times.begin(), times.begin(), times.end());
  return without;
}

// Lenses need only be accurate to the tolerance of the view graph.
constexpr int kNumBundleRounds = 2;
constexpr double kFunctionTolerance = 1e-5;

MapperOptions OptionsOfRounds(MapperOptions options) {
  options.is_for_lenses = true;
  options.pair_filtering.use_motion_continuity = false;
  options.bundle_adjustment.num_rounds =
      std::min<int>(options.bundle_adjustment.num_rounds, kNumBundleRounds);
  options.bundle_adjustment.function_tolerance = std::max<double>(
      options.bundle_adjustment.function_tolerance, kFunctionTolerance);
  return options;
}

std::optional<LensModel> FirstModel(MapperResult mapped) {
  if (mapped.models.empty()) return std::nullopt;
  return LensModel{std::move(mapped.models[0].reconstruction),
                   std::move(mapped.models[0].focal_lengths)};
}

// Maps the scene. First estimates the lenses without calibration, if there are
// any, from pairs and then by maps of a part of the scene
// (lenses/lens_calibration.h).
MapperResult MapWithLenses(const PairStep& map_pairs, const MapperInput& input,
                           const MapperOptions& options,
                           const Context& context) {
  if (!NeedsLenses(input.scene, options.focal_lengths)) {
    return MapScene(
        map_pairs,
        {input, input.scene, input.view_graph, {}, options, context});
  }
  Scene scene = input.scene;
  scene.cameras = WithoutExif(std::move(scene.cameras));
  std::vector<StageTime> times;
  const RunningStage pair_stage("focal lengths", context);
  FocalLengthResult focal_lengths = CalibrateFocalLengths(
      scene, input.view_graph, options.focal_lengths, pair_stage.context());
  pair_stage.Finish(&times);
  LogFocalLengths(scene, focal_lengths, context);
  const std::vector<Camera> start =
      StartOfLenses(input.scene.cameras, focal_lengths);
  const auto uncalibrated = DropUncalibratedGeometry(scene, input.view_graph);
  const auto map = [&](const Lenses& lenses, const ViewGraph& matches,
                       const MapperOptions& of_round,
                       const Context& context_of_round) {
    scene.cameras = lenses.cameras;
    return MapScene(map_pairs, {input, scene, matches, lenses.prior, of_round,
                                context_of_round});
  };
  const LensOptions lens_options{options.focal_lengths,
                                 options.bundle_adjustment,
                                 options.view_graph.max_error_px};
  LensResult lenses{{start}, {}};
  if (!input.existing_model) {
    const RunningStage lens_stage("lenses", context);
    const MapperOptions of_rounds = OptionsOfRounds(options);
    Context quiet = lens_stage.context();
    quiet.log = nullptr;
    const LensMapper map_round = [&](const Lenses& of_round,
                                     const ViewGraph& matches) {
      return FirstModel(map(of_round, matches, of_rounds, quiet));
    };
    lenses = CalibrateLenses({scene, input.scene.cameras, start, uncalibrated},
                             map_round, lens_options, lens_stage.context());
    lens_stage.Finish(&times);
  }
  MapperResult result = map(lenses.lenses, uncalibrated, options, context);
  if (!result.models.empty() &&
      UpdateLenses(result.models[0].reconstruction,
                   result.models[0].focal_lengths, lens_options, &lenses)) {
    context.Info("the lenses changed; the scene is mapped again with them");
    result = map(lenses.lenses, uncalibrated, options, context);
  }
  for (MapperModel& model : result.models) {
    StateInitialFocalLengths(input.scene, &model.focal_lengths);
  }
  result.focal_lengths = std::move(focal_lengths.estimates);
  if (!lenses.summary.lenses.empty()) {
    result.lenses = std::move(lenses.summary);
  }
  result.times.insert(result.times.begin(), times.begin(), times.end());
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
  return RunMapperBy(
      [&](const Run& run, VerifiedPairs* pairs, MapperResult* result) {
        MapVerifiedPairs(estimate_positions, run, pairs, result);
      },
      input, options, context);
}

MapperResult RunMapperBy(const PairStep& map_pairs, const MapperInput& input,
                         const MapperOptions& options, const Context& context) {
  (void)ParseMetricScale(options.metric_scale, input.scene);  // may throw
  CheckTimes(input.scene, options.soft_rig.method);
  MapperResult result = MapWithLenses(map_pairs, input, options, context);
  AddUncertainFocalLengths(
      input.scene, options.bundle_adjustment.max_focal_length_sigma, &result);
  LogFindings(result, context);
  return result;
}

}  // namespace mgsfm

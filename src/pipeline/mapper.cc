// SPDX-License-Identifier: BSD-3-Clause
#include "mgsfm/pipeline/mapper.h"

#include <algorithm>
#include <cstdio>
#include <utility>

#include "mgsfm/base/error.h"
#include "mgsfm/base/mask.h"
#include "pair_filtering/fixed_regions.h"
#include "pair_filtering/frame_pair_index.h"
#include "pair_filtering/rejected_groups.h"
#include "pipeline/input_check.h"
#include "pipeline/known_rigs.h"
#include "pipeline/lens_calibration.h"
#include "pipeline/mapper_recipe.h"
#include "pipeline/metric_scale.h"
#include "pipeline/model_adjustment.h"
#include "pipeline/model_extension.h"
#include "pipeline/motion_jumps.h"
#include "pipeline/position_recipe.h"
#include "pipeline/rotation_recipe.h"
#include "pipeline/scene_rotations.h"
#include "pipeline/side_alignment.h"
#include "pipeline/timed.h"
#include "pipeline/weak_seams.h"

namespace mgsfm {
namespace {

std::vector<int> CountFrames(const RotationEstimate& rotations) {
  std::vector<int> num_frames;
  for (const std::optional<int>& component : rotations.component) {
    if (!component) continue;
    if (*component >= static_cast<int>(num_frames.size())) {
      num_frames.resize(*component + 1, 0);
    }
    ++num_frames[*component];
  }
  return num_frames;
}

// The estimate restricted to one connected component.
RotationEstimate SelectComponent(const Scene& scene,
                                 const ViewGraph& view_graph,
                                 const RotationEstimate& all, int component) {
  RotationEstimate selected = all;
  for (size_t i = 0; i < scene.frames.size(); ++i) {
    if (all.component[i] == component) continue;
    selected.rig_from_world[i].reset();
    selected.component[i].reset();
  }
  for (size_t i = 0; i < view_graph.pairs.size(); ++i) {
    const int frame_idx =
        scene.images[view_graph.pairs[i].image_idx1].frame_idx;
    if (all.component[frame_idx] != component)
      selected.pair_is_inlier[i] = false;
  }
  return selected;
}

// The pairs whose matches make tracks: the inliers of the component without
// those that contradict its positions, so that neither wrong matches nor
// duplicate structures join different points.
Mask UsedPairs(const RotationEstimate& rotations,
               const Mask& pair_is_inconsistent) {
  Mask pair_is_used = rotations.pair_is_inlier;
  pair_is_used.Remove(pair_is_inconsistent);
  return pair_is_used;
}

// Groups of pairs that the rotations or positions of the component contradict.
// Pairs on moving objects are no evidence against either.
std::vector<RejectedGroup> FindRejectedGroups(const Scene& scene,
                                              const FramePairIndex& index,
                                              const ViewGraph& view_graph,
                                              const RotationEstimate& rotations,
                                              const Mask& pair_is_inconsistent,
                                              const PairVerdicts& verdicts) {
  Mask is_rejected = pair_is_inconsistent;
  for (size_t i = 0; i < is_rejected.size(); ++i) {
    const ImagePair& pair = view_graph.pairs[i];
    const bool is_rotation_known =
        pair.relative_pose && rotations.CamFromWorld(scene, pair.image_idx1) &&
        rotations.CamFromWorld(scene, pair.image_idx2);
    if (is_rotation_known && !rotations.pair_is_inlier[i] &&
        verdicts[i] != RejectionReason::kDiscontinuousMotion) {
      is_rejected[i] = true;
    }
  }
  return GroupRejectedPairs(index, is_rejected);
}

void LogRejectedPairs(const Scene& scene,
                      const std::vector<RejectedGroup>& groups,
                      size_t num_pairs, const Context& context) {
  int num_rejected = 0;
  for (const RejectedGroup& group : groups) {
    num_rejected += static_cast<int>(group.pair_idxs.size());
    context.Debug(DescribeRejectedGroup(scene, group));
  }
  if (num_rejected == 0) return;
  context.Info(std::to_string(num_rejected) + " of " +
               std::to_string(num_pairs) +
               " image pairs contradict the others and are not used");
}

// The measurements that all connected components share.
struct Measurements {
  const Scene& scene;
  const Bearings& bearings;
  const ViewGraph& view_graph;
  const ViewGraph& matches;     // of the input
  const FramePairIndex& index;  // of the view graph
  const PositionPriors& position_priors;
  const GravityPriors& gravity_priors;
  const LengthHints& length_hints;
  const std::vector<std::optional<Rigid3>>& pair_on_path;
  const ModelObserver& observer;
  SharedCalibration& calibration;  // of all models
};

PositionInput PositionInputOf(const Measurements& measurements,
                              const Scene& scene,
                              const RotationEstimate& rotations,
                              const ObservationGroups& tracks) {
  PositionInput input{scene,
                      measurements.bearings,
                      measurements.view_graph,
                      measurements.index,
                      rotations,
                      tracks,
                      measurements.length_hints};
  if (!measurements.observer) return input;
  input.observer = [&](const PositionEstimate& positions) {
    measurements.observer(JoinEstimates(measurements.scene, rotations,
                                        positions, ObservationGroups()));
  };
  return input;
}

// The models of one connected component: one, unless it is split at seams.
std::vector<MapperModel> ReconstructComponent(
    const PositionStep& estimate_positions, const Measurements& measurements,
    RotationEstimate rotations, const MapperOptions& options,
    const Context& context, PairVerdicts* verdicts) {
  const Scene& scene = measurements.scene;
  const ViewGraph& view_graph = measurements.view_graph;
  const FramePairIndex& index = measurements.index;
  MapperModel model;
  const TrackResult tracks = Timed("tracks", context, &model.times, [&] {
    return EstablishTracks(scene, view_graph, rotations.pair_is_inlier,
                           options.tracks, context);
  });
  model.tracks = tracks.summary;

  const CalibrationPrior prior =
      measurements.calibration.PriorFor(FramesWith(rotations.rig_from_world));
  PositionResult translation =
      Timed("translation averaging", context, &model.times, [&] {
        const auto average = [&](const Scene& with_rig) {
          return estimate_positions(
              PositionInputOf(measurements, with_rig, rotations,
                              tracks.estimate),
              {options.translation_averaging, options.pair_filtering}, context);
        };
        if (!HasLength(prior)) return average(scene);
        PositionResult result = average(WithKnownSensors(scene, prior));
        result.summary.is_metric &= std::any_of(
            scene.sensors.begin(), scene.sensors.end(), HasKnownLength);
        return result;
      });
  if (translation.corrected_rig_from_world) {
    rotations.rig_from_world = *std::move(translation.corrected_rig_from_world);
  }
  model.translation = std::move(translation.summary);
  Reject(translation.pair_is_inconsistent,
         RejectionReason::kInconsistentBaseline, verdicts);
  model.rejected_groups =
      FindRejectedGroups(scene, index, view_graph, rotations,
                         translation.pair_is_inconsistent, *verdicts);
  LogRejectedPairs(scene, model.rejected_groups, view_graph.pairs.size(),
                   context);

  Reconstruction initial =
      JoinEstimates(scene, rotations, translation.estimate, tracks.estimate);
  AdjustmentInput input{scene, view_graph, measurements.matches,
                        measurements.position_priors,
                        measurements.gravity_priors};
  input.pair_is_used = UsedPairs(rotations, translation.pair_is_inconsistent);
  input.is_metric = model.translation.is_metric;
  input.observer = measurements.observer;
  input.calibration = &measurements.calibration;
  if (input.observer) input.observer(initial);
  AdjustModel(input, options, context, std::move(initial), &model);
  if (options.is_for_lenses) return {std::move(model)};
  const auto confidence_of = [&](const Mask& used,
                                 const MapperModel& adjusted) {
    const ComparedMotions motions =
        CompareMotions(scene, index, view_graph, measurements.pair_on_path,
                       adjusted.reconstruction);
    return EstimateModelConfidence(
        {scene, index, view_graph, used, adjusted.rejected_groups,
         adjusted.reconstruction, motions.jumps, motions.confirmed},
        options, context);
  };
  model.confidence = confidence_of(input.pair_is_used, model);
  RealignSides(index, options, context, confidence_of, &input, &model);
  const std::vector<Seam> seams = SeamsToSplit(scene, model, options);
  if (!seams.empty()) {
    context.Info("the model is split at " + std::to_string(seams.size()) +
                 " of its weak seams");
    return SplitAtSeams(input, options, context, seams, confidence_of, model);
  }
  return {std::move(model)};
}

// Sorts by descending number of frames, which splitting a component changes.
void SortBySize(std::vector<MapperModel>* models) {
  const auto num_frames = [](const MapperModel& model) {
    const auto& poses = model.reconstruction.rig_from_world;
    return std::count_if(poses.begin(), poses.end(),
                         [](const auto& pose) { return pose.has_value(); });
  };
  std::stable_sort(models->begin(), models->end(),
                   [&](const MapperModel& a, const MapperModel& b) {
                     return num_frames(a) > num_frames(b);
                   });
}

// Drops the models of fewer than min_model_size images, but never the first
// one. Returns which frames they have.
Mask DropSmallModels(const Scene& scene, int min_model_size,
                     std::vector<MapperModel>* models) {
  Mask is_dropped(scene.frames.size(), false);
  if (models->empty()) return is_dropped;
  const auto small = std::stable_partition(
      models->begin() + 1, models->end(), [&](const MapperModel& model) {
        return model.reconstruction.NumRegisteredImages(scene) >=
               min_model_size;
      });
  for (auto model = small; model != models->end(); ++model) {
    for (size_t i = 0; i < is_dropped.size(); ++i) {
      if (model->reconstruction.rig_from_world[i]) is_dropped[i] = true;
    }
  }
  models->erase(small, models->end());
  return is_dropped;
}

std::vector<UnregisteredFrame> ExplainUnregistered(
    const Scene& scene, const RotationEstimate& rotations,
    const std::vector<int>& num_frames_of_component,
    const Mask& is_in_small_model, const Mask& is_ambiguous,
    const MapperOptions& options, const std::vector<MapperModel>& models) {
  std::vector<UnregisteredFrame> unregistered;
  for (size_t i = 0; i < scene.frames.size(); ++i) {
    const bool is_registered =
        std::any_of(models.begin(), models.end(), [i](const MapperModel& m) {
          return m.reconstruction.rig_from_world[i].has_value();
        });
    if (is_registered) continue;
    std::string reason;
    if (!rotations.component[i] && !is_ambiguous.empty() && is_ambiguous[i]) {
      reason =
          "its motion is ambiguous: two rigid motions explain its matches "
          "equally well";
    } else if (!rotations.component[i]) {
      reason = "no image pair with consistent geometry links it to others";
    } else if (num_frames_of_component[*rotations.component[i]] <
               options.min_num_frames) {
      reason = "its connected component has fewer than " +
               std::to_string(options.min_num_frames) + " frames";
    } else if (is_in_small_model[i]) {
      reason = "its model has fewer than " +
               std::to_string(options.min_model_size) + " images";
    } else {
      reason = options.weak_seams == WeakSeams::kKeep
                   ? "too few points constrain its position"
                   : "a weak seam separates it, or too few points constrain "
                     "its position";
    }
    unregistered.push_back({static_cast<int>(i), reason});
  }
  return unregistered;
}

// The models of all components of the rotations, by descending number of
// frames.
std::vector<MapperModel> ReconstructComponents(
    const PositionStep& estimate_positions, const Measurements& measurements,
    const std::vector<int>& num_frames, const MapperOptions& options,
    const Context& context, EstimatedRotations* rotation) {
  std::vector<MapperModel> all;
  size_t num_learned = 0;
  for (size_t component = 0; component < num_frames.size(); ++component) {
    if (num_frames[component] < options.min_num_frames) continue;
    for (; num_learned < all.size(); ++num_learned) {
      measurements.calibration.Learn(all[num_learned],
                                     measurements.position_priors,
                                     options.bundle_adjustment, context);
    }
    context.Info("component " + std::to_string(component) + ": " +
                 std::to_string(num_frames[component]) + " frames");
    std::vector<MapperModel> models = ReconstructComponent(
        estimate_positions, measurements,
        SelectComponent(measurements.scene, measurements.view_graph,
                        rotation->estimate, static_cast<int>(component)),
        options, context, &rotation->verdicts);
    for (MapperModel& model : models) {
      if (!IsLargeEnough(model, options)) continue;
      model.num_frames_in_component = num_frames[component];
      all.push_back(std::move(model));
    }
  }
  SortBySize(&all);
  return all;
}

// The verified pairs, and the matches without those of fixed regions, if there
// are any.
struct VisiblePairs {
  ViewGraphResult verified;
  std::optional<ViewGraph> matches;
  FixedRegions fixed;
};

// Verifies again without the matches of fixed regions.
VisiblePairs VerifyVisible(const Scene& scene, const Bearings& bearings,
                           const ViewGraph& all_matches,
                           const MapperOptions& options, const Context& context,
                           std::vector<StageTime>* times) {
  const auto verify = [&](const char* stage, const ViewGraph& matches) {
    return Timed(stage, context, times, [&] {
      return EstimateViewGraph(scene, bearings, matches, options.view_graph,
                               context);
    });
  };
  VisiblePairs pairs{verify("view graph", all_matches), {}, {}};
  if (!options.pair_filtering.use_fixed_regions) return pairs;
  const ViewGraph& verified = pairs.verified.estimate;
  pairs.fixed = FindFixedRegions(
      scene, bearings,
      FramePairIndex(scene, verified, options.pair_filtering.is_sequence),
      verified, options.view_graph.max_error_px);
  if (!pairs.fixed.Any()) return pairs;
  pairs.matches = DropFixedRegions(scene, pairs.fixed, all_matches, context);
  pairs.verified = verify("visible view graph", *pairs.matches);
  return pairs;
}

std::vector<FixedRegion> ListFixedRegions(const FixedRegions& regions) {
  std::vector<FixedRegion> list;
  for (size_t s = 0; s < regions.of_sensor.size(); ++s) {
    if (regions.of_sensor[s].empty()) continue;
    list.push_back({static_cast<int>(s), FixedRegions::kNumRows,
                    FixedRegions::kNumColumns, regions.of_sensor[s]});
  }
  return list;
}

// The models, the verdicts about pairs, and the frames without a model.
void ReconstructScene(const PositionStep& estimate_positions,
                      const Measurements& measurements,
                      const MapperOptions& options, const Context& context,
                      RotationsOfScene* of_scene, MapperResult* result) {
  EstimatedRotations& rotation = of_scene->rotation;
  const std::vector<int> num_frames = CountFrames(rotation.estimate);
  result->models =
      ReconstructComponents(estimate_positions, measurements, num_frames,
                            options, context, &rotation);
  const Mask is_in_small_model = DropSmallModels(
      measurements.scene, options.min_model_size, &result->models);
  result->rejected_pairs = CountRejections(rotation.verdicts);
  result->unregistered_frames = ExplainUnregistered(
      measurements.scene, rotation.estimate, num_frames, is_in_small_model,
      of_scene->frame_is_ambiguous, options, result->models);
}

// Rays and verified pairs.
struct VerifiedScene {
  const Scene& scene;
  const CalibrationPrior& lenses;
  const ViewGraph& all_matches;
  Bearings bearings = {};
  VisiblePairs pairs = {};

  const ViewGraph& matches() const {
    return pairs.matches ? *pairs.matches : all_matches;
  }
};

// The stages from rotations to models.
void MapVerified(const PositionStep& estimate_positions,
                 const MapperInput& input, const MapperOptions& options,
                 const Context& context, VerifiedScene* verified,
                 MapperResult* result) {
  const Scene& scene = verified->scene;
  ViewGraph& view_graph = verified->pairs.verified.estimate;
  const FramePairIndex index(scene, view_graph,
                             options.pair_filtering.is_sequence);
  RotationsOfScene of_scene = EstimateRotationsOfScene(
      scene, verified->bearings, index, verified->matches(),
      input.gravity_priors, options, context, &view_graph, &result->times);
  EstimatedRotations& rotation = of_scene.rotation;
  result->rotation = std::move(rotation.summary);
  result->gravity_rejection = std::move(rotation.gravity_rejection);
  const GravityPriors gravity =
      result->gravity_rejection ? GravityPriors() : input.gravity_priors;
  SharedCalibration calibration(scene, verified->lenses);
  const Measurements measurements{scene,
                                  verified->bearings,
                                  view_graph,
                                  verified->matches(),
                                  index,
                                  input.position_priors,
                                  gravity,
                                  of_scene.length_hints,
                                  of_scene.pair_on_path,
                                  input.observer,
                                  calibration};
  ReconstructScene(estimate_positions, measurements, options, context,
                   &of_scene, result);
}

// The stages from the rays on, with the cameras of `scene`. Lenses are
// calibrated on some pairs without the checks of the input, which a wrong lens
// misleads.
MapperResult MapCalibrated(const PositionStep& estimate_positions,
                           VerifiedScene verified, const MapperInput& input,
                           bool checks_input, const MapperOptions& options,
                           const Context& context) {
  MapperResult result;
  const Scene& scene = verified.scene;
  verified.bearings = Timed("rays", context, &result.times, [&] {
    return ComputeBearings(scene, context.num_threads);
  });
  verified.pairs = VerifyVisible(scene, verified.bearings, verified.all_matches,
                                 options, context, &result.times);
  const ViewGraph& view_graph = verified.pairs.verified.estimate;
  result.view_graph = verified.pairs.verified.summary;
  result.fixed_regions = ListFixedRegions(verified.pairs.fixed);
  if (checks_input) CheckKnownRigs(scene, view_graph);
  if (input.existing_model) {
    ExtendModel(scene, verified.bearings, view_graph, *input.existing_model,
                options, context, input.position_priors, input.gravity_priors,
                input.observer, &result);
  } else {
    MapVerified(estimate_positions, input, options, context, &verified,
                &result);
  }
  if (!checks_input) return result;
  Timed("input check", context, &result.times, [&] {
    CheckInput(scene, verified.matches(), view_graph, input, options, context,
               &result);
    return true;
  });
  return result;
}

// Estimates lenses without calibration first.
MapperResult CalibrateAndMap(const PositionStep& estimate_positions,
                             const MapperInput& input,
                             const MapperOptions& options,
                             const Context& context) {
  Scene scene = input.scene;
  scene.cameras = WithoutExif(std::move(scene.cameras));
  std::vector<StageTime> times;
  FocalLengthResult focal_lengths =
      Timed("focal lengths", context, &times, [&] {
        return CalibrateFocalLengths(scene, input.view_graph,
                                     options.focal_lengths, context);
      });
  LogFocalLengths(scene, focal_lengths, context);
  const std::vector<Camera> start =
      StartOfLenses(input.scene.cameras, focal_lengths);
  const ViewGraph uncalibrated =
      DropUncalibratedGeometry(scene, input.view_graph);
  const auto map = [&](const MapperInput& of_stages, bool is_complete) {
    return [&, is_complete](const Lenses& lenses, const ViewGraph& matches,
                            const MapperOptions& of_round,
                            const Context& of_context) {
      scene.cameras = lenses.cameras;
      return MapCalibrated(estimate_positions, {scene, lenses.prior, matches},
                           of_stages, is_complete, of_round, of_context);
    };
  };
  LensResult lenses{{start}, {}};
  if (!input.existing_model) {
    const MapperInput no_priors;
    lenses = Timed("lenses", context, &times, [&] {
      return CalibrateLenses({scene, input.scene.cameras, start, uncalibrated},
                             map(no_priors, false), options, context);
    });
  }
  MapperResult result =
      MapWithLenses(uncalibrated, map(input, true), options, context, &lenses);
  for (MapperModel& model : result.models) {
    AddModelErrors(input.scene, &model);
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
  (void)ParseMetricScale(options.metric_scale, input.scene);  // may throw
  MapperResult result =
      NeedsLenses(input.scene, options)
          ? CalibrateAndMap(estimate_positions, input, options, context)
          : MapCalibrated(estimate_positions,
                          {input.scene, {}, input.view_graph}, input, true,
                          options, context);
  AddUncertainFocalLengths(input.scene, &result);
  LogFindings(result, context);
  return result;
}

}  // namespace mgsfm

// SPDX-License-Identifier: BSD-3-Clause
#include "mapper/model_extension.h"

#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "mapper/components.h"
#include "mapper/model_adjustment.h"
#include "mapper/model_world.h"
#include "mapper/pair_judgement.h"
#include "mapper/stage.h"
#include "mgsfm/base/error.h"
#include "mgsfm/base/mask.h"
#include "mgsfm/incremental/incremental_mapping.h"
#include "mgsfm/mapper/mapper.h"
#include "pair_filtering/frame_pair_index.h"
#include "registration/known_lengths.h"
#include "soft_rig/shared_calibration.h"

namespace mgsfm {
namespace {

FixedPoses FixAllOf(const Reconstruction& model) {
  FixedPoses fixed;
  for (const auto& pose : model.rig_from_world) {
    fixed.frames.push_back(pose.has_value());
  }
  for (const auto& pose : model.sensor_from_rig) {
    fixed.sensors.push_back(pose.has_value());
  }
  return fixed;
}

// Whether known poses of sensors determine the unit of length of the model.
bool IsMetric(const Scene& scene, const Reconstruction& start) {
  for (size_t i = 0; i < scene.sensors.size(); ++i) {
    if (start.sensor_from_rig[i] && HasKnownLength(scene.sensors[i])) {
      return true;
    }
  }
  return false;
}

// Known poses replace the poses of the model, which differ little.
Reconstruction AtKnownPoses(const Scene& scene, Reconstruction model) {
  for (size_t i = 0; i < scene.sensors.size(); ++i) {
    auto& pose = model.sensor_from_rig[i];
    if (pose && scene.sensors[i].sensor_from_rig) {
      pose = scene.sensors[i].sensor_from_rig;
    }
  }
  return model;
}

void ListFramesNotAdded(const Scene& scene,
                        const std::vector<ResectedFrame>& rejected,
                        const MapperOptions& options, const Context& context,
                        const MapperModel& model, MapperResult* result) {
  std::vector<std::string> reasons(scene.frames.size());
  for (const ResectedFrame& frame : rejected) {
    reasons[frame.frame_idx] =
        ReasonForRejection(frame, options.extension.resection);
  }
  ListFramesWithoutPose(model, std::move(reasons), result);
  if (result->unregistered_frames.empty()) return;
  const UnregisteredFrame& first = result->unregistered_frames.front();
  context.Warning(std::to_string(result->unregistered_frames.size()) +
                  " frames are not in the model; the first is '" +
                  scene.frames[first.frame_idx].name + "': " + first.reason);
}

void WarnOfSensors(const Scene& scene, const Reconstruction& model,
                   const Context& context) {
  for (size_t i = 0; i < scene.sensors.size(); ++i) {
    if (model.sensor_from_rig[i]) continue;
    context.Warning("the images of camera '" + scene.sensors[i].name +
                    "' are not in the model: too few of them see enough "
                    "points to calibrate the camera in its rig");
  }
}

// Position priors and a soft rig would move frames that are to be fixed.
void CheckExtensionOptions(const MapperOptions& options,
                           const PositionPriors& priors) {
  if (!options.extension.fix_existing_frames) return;
  if (!priors.IsEmpty()) {
    throw Error(
        "Mapper.fix_existing_frames fixes the existing model, but position "
        "priors would move it; use one of them");
  }
  const SoftRig method = options.soft_rig.method;
  if (method != SoftRig::kAuto && method != SoftRig::kNone) {
    throw Error(
        "Mapper.fix_existing_frames fixes images, but SoftRig.method would "
        "move them; use one of them");
  }
}

// The points of the model stand for the matches of its images, so that only the
// rules need their pairs.
void DropPairsOf(const Reconstruction& model, const Scene& scene,
                 const ViewGraph& view_graph, Mask* pair_is_used) {
  for (size_t i = 0; i < view_graph.pairs.size(); ++i) {
    const ImagePair& pair = view_graph.pairs[i];
    if (model.IsRegistered(scene, pair.image_idx1) &&
        model.IsRegistered(scene, pair.image_idx2)) {
      (*pair_is_used)[i] = false;
    }
  }
}

// Grows the model. Its points are those of the start and of the new tracks.
IncrementalResult GrowExisting(const MapperRunInput& run,
                               const Bearings& bearings,
                               const Mask& pair_is_of_neighbors,
                               const AdjustmentInput& input,
                               const MapperOptions& options,
                               const Context& context) {
  IncrementalResult grown =
      GrowModel({input.scene, bearings, input.view_graph, input.pair_is_used,
                 pair_is_of_neighbors},
                {*input.start, input.held},
                {options.extension.resection, options.bundle_adjustment,
                 options.tracks, options.match_selection},
                context, run.input.observer);
  Reconstruction& model = grown.estimate.front();
  if (!input.keeps_points) return grown;
  if (input.held.frames.empty()) {
    TransformWorld(
        AlignToModel(input.scene, *input.start, model, input.is_metric),
        &model);
  }
  model.points = input.start->points;
  model = TriangulateCandidates(
      input.scene, CandidatesOf(input, input.scene, options, context),
      std::move(model), options.bundle_adjustment, context);
  return grown;
}

}  // namespace

std::string ReasonForRejection(const ResectedFrame& frame,
                               const ResectionOptions& options) {
  if (frame.num_images == 0) {
    return "the poses of its cameras in the rig are unknown, because none of "
           "their images sees enough points of the model";
  }
  const std::string num_keypoints = std::to_string(frame.num_keypoints);
  if (frame.num_keypoints < options.abs_pose_min_num_inliers) {
    return "only " + num_keypoints +
           " of its keypoints match points of the model";
  }
  return "only " + std::to_string(frame.num_inliers) + " of its " +
         num_keypoints + " matched keypoints agree on its pose";
}

void DescribeSensors(const Scene& scene, const Reconstruction& start,
                     const std::vector<PlacedSensor>& placed,
                     MapperModel* model, MapperResult* result) {
  std::vector<int> num_frames(scene.sensors.size(), 0);
  for (const PlacedSensor& sensor : placed) {
    num_frames[sensor.sensor_idx] = sensor.num_frames;
  }
  for (size_t i = 0; i < scene.sensors.size(); ++i) {
    SensorRotationSummary rotation;
    rotation.num_samples = num_frames[i];
    rotation.is_observable =
        model->reconstruction.sensor_from_rig[i].has_value();
    if (scene.IsReference(static_cast<int>(i))) {
      rotation.message = "reference sensor";
    } else if (num_frames[i] > 0) {
      rotation.message = "estimated by resection of single images";
    } else if (scene.sensors[i].sensor_from_rig && rotation.is_observable) {
      rotation.message = "known";
    } else if (start.sensor_from_rig[i]) {
      rotation.message = "taken from the existing model";
    } else {
      rotation.message = "no image sees enough points of the model";
    }
    SensorTranslationSummary translation;
    translation.is_observable = rotation.is_observable;
    translation.message = rotation.message;
    result->rotation.sensors.push_back(std::move(rotation));
    model->translation.sensors.push_back(std::move(translation));
  }
}

void ExtendModel(const MapperRunInput& run, const PairsOfExtension* selected,
                 VerifiedPairs* verified, MapperResult* result) {
  CheckExtensionOptions(run.options, run.input.position_priors);
  const Context& context = run.context;
  const Reconstruction& existing = *run.input.existing_model;
  const auto [verdicts, pair_is_of_neighbors] =
      JudgePairsOfExtension(run, selected, verified, &result->times);
  const VerifiedPairs& pairs = *verified;
  const bool keeps_points = selected != nullptr;
  const ViewGraph& view_graph = pairs.view_graph;
  result->rejected_pairs =
      CountRejections(verdicts, pairs.num_of_fixed_regions);
  const bool are_fixed = run.options.extension.fix_existing_frames;
  const Reconstruction start =
      are_fixed ? existing : AtKnownPoses(pairs.scene, existing);
  const std::optional<Scene> adapted =
      AdaptKnownLengths({pairs.scene, pairs.bearings, view_graph, start},
                        run.options.extension.resection, context);
  const Scene& scene = adapted ? *adapted : pairs.scene;
  MapperOptions options = run.options;
  if (keeps_points) options.bundle_adjustment.num_rounds = 1;
  MapperModel model;
  AdjustmentInput input{scene, view_graph,
                        keeps_points ? run.matches : view_graph,
                        run.input.position_priors, run.input.gravity_priors};
  input.pair_is_used = UsablePairs(verdicts);
  if (keeps_points) DropPairsOf(start, scene, view_graph, &input.pair_is_used);
  input.is_metric = IsMetric(scene, start);
  input.keeps_points = keeps_points;
  input.start = &start;
  input.observer = run.input.observer;
  if (are_fixed) input.held = FixAllOf(start);
  const RunningStage stage("incremental mapping", context);
  IncrementalResult grown =
      GrowExisting(run, pairs.bearings, pair_is_of_neighbors, input, options,
                   stage.context());
  stage.Finish(&model.times);
  model.extension.emplace();
  model.extension->added_frames = std::move(grown.added);
  model.extension->placed_sensors = std::move(grown.summary.placed_sensors);
  model.extension->frames_are_fixed = are_fixed;
  model.extension->num_existing_frames =
      static_cast<int>(FramesWith(start.rig_from_world).Count());
  model.num_frames_in_component = static_cast<int>(scene.frames.size());
  AdjustModel(input, options, context, std::move(grown.estimate.front()),
              &model);
  DescribeSensors(scene, start, model.extension->placed_sensors, &model,
                  result);
  ListFramesNotAdded(scene, grown.rejected, options, context, model, result);
  WarnOfSensors(scene, model.reconstruction, context);
  if (!model.reconstruction.points.empty()) {
    result->models.push_back(std::move(model));
  }
}

MapperResult TriangulatePoints(const MapperInput& input,
                               const MapperOptions& options,
                               const Context& context) {
  MGSFM_CHECK_MSG(input.existing_model.has_value(),
                  "the poses of an existing model are required");
  const Scene& scene = input.scene;
  const Reconstruction& start = *input.existing_model;
  MapperResult result;
  MapperModel model;
  const RunningStage verification("view graph", context);
  const ViewGraphResult verified = EstimateViewGraph(
      scene, ComputeBearings(scene, context.num_threads), input.view_graph,
      options.view_graph, verification.context());
  verification.Finish(&result.times);
  result.view_graph = verified.summary;
  const CandidateSource candidates = MakeCandidateSource(
      scene, verified.estimate, input.view_graph,
      Mask(verified.estimate.pairs.size(), true), options, context);
  const RunningStage triangulation("triangulation", context);
  Reconstruction initial =
      TriangulateCandidates(scene, candidates, start, options.bundle_adjustment,
                            triangulation.context());
  triangulation.Finish(&model.times);
  const RunningStage refinement("refinement", context);
  BundleResult bundle =
      RefineReconstruction(scene, candidates, std::move(initial),
                           options.bundle_adjustment, refinement.context());
  refinement.Finish(&model.times);
  model.bundle = std::move(bundle.summary);
  model.reconstruction = std::move(bundle.estimate);
  model.extension = ExtensionSummary();
  model.extension->frames_are_fixed =
      !options.bundle_adjustment.refine_rig_from_world;
  model.extension->num_existing_frames =
      static_cast<int>(FramesWith(start.rig_from_world).Count());
  ListFramesWithoutPose(
      model,
      std::vector<std::string>(scene.frames.size(),
                               "it is not in the input model"),
      &result);
  model.num_frames_in_component = model.extension->num_existing_frames;
  DescribeSensors(scene, start, {}, &model, &result);
  if (!model.reconstruction.points.empty()) {
    result.models.push_back(std::move(model));
  }
  return result;
}

}  // namespace mgsfm

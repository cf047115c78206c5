// SPDX-License-Identifier: BSD-3-Clause
#include "mapper/model_extension.h"

#include <algorithm>
#include <optional>
#include <string>
#include <utility>

#include "mapper/candidates.h"
#include "mapper/model_adjustment.h"
#include "mapper/stage.h"
#include "math/statistics.h"
#include "mgsfm/base/error.h"
#include "mgsfm/base/mask.h"

namespace mgsfm {
namespace {

// The fixed input of all passes.
struct PassInput {
  const Scene& scene;
  const Bearings& bearings;
  const ViewGraph& view_graph;
  const Reconstruction& start;
  const CandidateSource& candidates;
  const MapperOptions& options;
  const Context& context;
  const ModelObserver& observer;
};

struct ExtendedModel {
  Reconstruction model;
  ExtensionSummary summary;
  std::vector<ResectedFrame> rejected;  // frames that could not be added
};

// Indices of the points that frames of the mask observe.
std::vector<size_t> PointsSeenBy(const Mask& frame_is_new, const Scene& scene,
                                 const Reconstruction& model) {
  std::vector<size_t> point_idxs;
  for (size_t i = 0; i < model.points.size(); ++i) {
    const std::vector<Observation>& track = model.points[i].track;
    if (std::any_of(track.begin(), track.end(), [&](const Observation& o) {
          return frame_is_new[scene.images[o.image_idx].frame_idx];
        })) {
      point_idxs.push_back(i);
    }
  }
  return point_idxs;
}

// Refines the new frames and their points. All other frames, the sensors of the
// existing model and all intrinsics are fixed.
void RefineNewFrames(const PassInput& input, const Mask& frame_is_new,
                     Reconstruction* model) {
  FixedPoses fixed;
  for (const bool is_new : frame_is_new) fixed.frames.push_back(!is_new);
  for (const auto& pose : input.start.sensor_from_rig) {
    fixed.sensors.push_back(pose.has_value());
  }
  BundleAdjustmentOptions options = input.options.bundle_adjustment;
  options.refine_focal_length = RefineMode::kNo;
  options.refine_principal_point = RefineMode::kNo;
  options.refine_extra_params = RefineMode::kNo;

  const std::vector<size_t> point_idxs =
      PointsSeenBy(frame_is_new, input.scene, *model);
  if (point_idxs.empty()) return;
  Reconstruction seen{
      model->cameras, model->sensor_from_rig, model->rig_from_world, {}};
  for (const size_t i : point_idxs) seen.points.push_back(model->points[i]);
  const BundleResult result =
      AdjustBundle(input.scene, seen, options, input.context, {}, fixed);
  model->sensor_from_rig = result.estimate.sensor_from_rig;
  model->rig_from_world = result.estimate.rig_from_world;
  for (size_t k = 0; k < point_idxs.size(); ++k) {
    model->points[point_idxs[k]] = result.estimate.points[k];
  }
}

// Resects the frames without a pose. Returns the mask of the frames that were
// added, or nullopt if neither a frame nor a sensor was.
std::optional<Mask> AddPass(const PassInput& input, ExtendedModel* extended) {
  const ResectionResult result = ResectFrames(
      input.scene, input.bearings, input.view_graph, extended->model,
      input.options.extension.resection, input.context);
  ExtensionSummary& summary = extended->summary;
  const int pass = summary.num_passes + 1;
  Mask frame_is_new(input.scene.frames.size());
  extended->rejected.clear();
  for (const ResectedFrame& frame : result.frames) {
    if (!frame.is_added) {
      extended->rejected.push_back(frame);
      continue;
    }
    frame_is_new[frame.frame_idx] = true;
    summary.added_frames.push_back({pass, frame});
  }
  const size_t num_added = frame_is_new.Count();
  if (num_added == 0 && result.sensors.empty()) return std::nullopt;
  summary.num_passes = pass;
  summary.placed_sensors.insert(summary.placed_sensors.end(),
                                result.sensors.begin(), result.sensors.end());
  input.context.Info("pass " + std::to_string(pass) + ": " +
                     std::to_string(num_added) + " frames added, " +
                     std::to_string(extended->rejected.size()) + " left");
  extended->model =
      TriangulateCandidates(input.scene, input.candidates, result.estimate,
                            input.options.bundle_adjustment, input.context);
  return frame_is_new;
}

ExtendedModel AddFrames(const PassInput& input) {
  ExtendedModel extended{input.start, {}, {}};
  while (const std::optional<Mask> frame_is_new = AddPass(input, &extended)) {
    RefineNewFrames(input, *frame_is_new, &extended.model);
    if (input.observer) input.observer(extended.model);
  }
  return extended;
}

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

// A known rig that is new to the model may have another unit of length, and its
// frames would then deform the model. Its sensors are therefore calibrated as
// if they were unknown, and the known lengths are scaled to the unit of the
// model. nullopt if no length differs.
std::optional<Scene> AdaptKnownLengths(const VerifiedPairs& pairs,
                                       const Reconstruction& start,
                                       const ResectionOptions& options,
                                       const Context& context) {
  constexpr double kMaxFactor = 1.1;  // errors of lengths stay below 10 %
  const Scene& scene = pairs.scene;
  Scene uncalibrated = scene;
  for (size_t i = 0; i < scene.sensors.size(); ++i) {
    const int ref_idx = scene.rigs[scene.sensors[i].rig_idx].ref_sensor_idx;
    if (start.sensor_from_rig[ref_idx]) continue;
    if (!HasKnownLength(scene.sensors[i])) continue;
    uncalibrated.sensors[i].sensor_from_rig.reset();
  }
  std::vector<std::vector<double>> factors(scene.rigs.size());
  const ResectionResult placed = ResectFrames(
      uncalibrated, pairs.bearings, pairs.view_graph, start, options, context);
  for (const PlacedSensor& sensor : placed.sensors) {
    const Sensor& known = scene.sensors[sensor.sensor_idx];
    if (!HasKnownLength(known)) continue;
    factors[known.rig_idx].push_back(
        placed.estimate.sensor_from_rig[sensor.sensor_idx]->translation.norm() /
        known.sensor_from_rig->translation.norm());
  }
  std::optional<Scene> adapted;
  for (size_t rig_idx = 0; rig_idx < scene.rigs.size(); ++rig_idx) {
    if (factors[rig_idx].empty()) continue;
    const double factor = Median(factors[rig_idx]);
    if (factor < kMaxFactor && factor > 1.0 / kMaxFactor) continue;
    if (!adapted) adapted = scene;
    const Rig& rig = scene.rigs[rig_idx];
    for (const int sensor_idx : rig.sensor_idxs) {
      auto& pose = adapted->sensors[sensor_idx].sensor_from_rig;
      if (pose) pose->translation *= factor;
    }
    context.Warning(
        "the known lengths in the rig of camera '" +
        scene.sensors[rig.ref_sensor_idx].name + "' are " +
        std::to_string(factor) +
        " times as long in the model, whose unit of length is kept");
  }
  return adapted;
}

// Known poses replace those of the model, which differ little.
Reconstruction AtKnownPoses(const Scene& scene, Reconstruction model) {
  for (size_t i = 0; i < scene.sensors.size(); ++i) {
    auto& pose = model.sensor_from_rig[i];
    if (pose && scene.sensors[i].sensor_from_rig) {
      pose = scene.sensors[i].sensor_from_rig;
    }
  }
  return model;
}

bool HasNewKnownRig(const Scene& scene, const Reconstruction& start) {
  return std::any_of(
      scene.sensors.begin(), scene.sensors.end(), [&](const Sensor& sensor) {
        const int ref_idx = scene.rigs[sensor.rig_idx].ref_sensor_idx;
        return HasKnownLength(sensor) && !start.sensor_from_rig[ref_idx];
      });
}

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

void ListUnregistered(const Scene& scene,
                      const std::vector<ResectedFrame>& rejected,
                      const MapperOptions& options, const Context& context,
                      const MapperModel& model, MapperResult* result) {
  std::vector<std::string> reasons(scene.frames.size());
  for (const ResectedFrame& frame : rejected) {
    reasons[frame.frame_idx] =
        ReasonForRejection(frame, options.extension.resection);
  }
  for (const DroppedFrame& frame : model.bundle.dropped_frames) {
    reasons[frame.frame_idx] = frame.reason;
  }
  for (size_t i = 0; i < scene.frames.size(); ++i) {
    if (model.reconstruction.rig_from_world[i]) continue;
    result->unregistered_frames.push_back({static_cast<int>(i), reasons[i]});
  }
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
  if (options.soft_rig.method != SoftRig::kNone) {
    throw Error(
        "Mapper.fix_existing_frames fixes images, but SoftRig.method would "
        "move them; use one of them");
  }
}

}  // namespace

bool HasKnownLength(const Sensor& sensor) {
  return sensor.sensor_from_rig &&
         !sensor.sensor_from_rig->translation.isZero(0.0);
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

void ExtendModel(const VerifiedPairs& pairs, const MapperInput& mapper_input,
                 const MapperOptions& options, const Context& context,
                 MapperResult* result) {
  const Reconstruction& existing = *mapper_input.existing_model;
  const ViewGraph& view_graph = pairs.view_graph;
  CheckExtensionOptions(options, mapper_input.position_priors);
  const bool are_fixed = options.extension.fix_existing_frames;
  const Reconstruction start =
      are_fixed ? existing : AtKnownPoses(pairs.scene, existing);
  std::optional<Scene> adapted;
  if (HasNewKnownRig(pairs.scene, start)) {
    adapted =
        AdaptKnownLengths(pairs, start, options.extension.resection, context);
  }
  const Scene& scene = adapted ? *adapted : pairs.scene;
  MapperModel model;
  AdjustmentInput input{scene, view_graph, view_graph,
                        mapper_input.position_priors,
                        mapper_input.gravity_priors};
  input.pair_is_used.assign(view_graph.pairs.size(), true);
  input.is_metric = IsMetric(scene, start);
  input.start = &start;
  input.observer = mapper_input.observer;
  if (are_fixed) input.held = FixAllOf(start);
  const CandidateSource candidates = MakeCandidateSource(
      scene, view_graph, view_graph, input.pair_is_used, options, context);
  const RunningStage stage("resection", context);
  ExtendedModel extended =
      AddFrames({scene, pairs.bearings, view_graph, start, candidates, options,
                 context, input.observer});
  stage.Finish(&model.times);
  model.extension = std::move(extended.summary);
  model.extension->frames_are_fixed = are_fixed;
  model.extension->num_existing_frames = static_cast<int>(std::count_if(
      start.rig_from_world.begin(), start.rig_from_world.end(),
      [](const std::optional<Rigid3>& pose) { return pose.has_value(); }));
  model.num_frames_in_component = static_cast<int>(scene.frames.size());
  AdjustModel(input, options, context, std::move(extended.model), &model);
  DescribeSensors(scene, start, model.extension->placed_sensors, &model,
                  result);
  ListUnregistered(scene, extended.rejected, options, context, model, result);
  WarnOfSensors(scene, model.reconstruction, context);
  if (!model.reconstruction.points.empty()) {
    result->models.push_back(std::move(model));
  }
}

}  // namespace mgsfm

// SPDX-License-Identifier: BSD-3-Clause
#include "pipeline/model_extension.h"

#include <algorithm>
#include <optional>
#include <string>
#include <utility>

#include "math/statistics.h"
#include "mgsfm/base/error.h"
#include "mgsfm/base/mask.h"
#include "pipeline/candidates.h"
#include "pipeline/model_adjustment.h"
#include "pipeline/timed.h"

namespace mgsfm {
namespace {

class FrameAdder {
 public:
  FrameAdder(const Scene& scene, const Bearings& bearings,
             const ViewGraph& view_graph, const Reconstruction& start,
             const CandidateSource& candidates, const MapperOptions& options,
             const Context& context)
      : scene_(scene),
        bearings_(bearings),
        view_graph_(view_graph),
        start_(start),
        candidates_(candidates),
        options_(options),
        context_(context),
        model_(start) {}

  // Passes until one adds nothing.
  Reconstruction Run() {
    while (AddPass()) RefineLastPass();
    return model_;
  }

  const ExtensionSummary& summary() const { return summary_; }
  // The frames that could not be added.
  const std::vector<ResectedFrame>& left() const { return left_; }

 private:
  bool AddPass();
  void RefineLastPass();
  // Positions of the points that frames of the last pass see.
  std::vector<size_t> PointsOfLastPass() const;

  const Scene& scene_;
  const Bearings& bearings_;
  const ViewGraph& view_graph_;
  const Reconstruction& start_;
  const CandidateSource& candidates_;
  const MapperOptions& options_;
  const Context& context_;
  Reconstruction model_;
  Mask is_of_last_pass_;  // per frame
  std::vector<ResectedFrame> left_;
  ExtensionSummary summary_;
};

// Whether anything was added.
bool FrameAdder::AddPass() {
  ResectionResult result = ResectFrames(scene_, bearings_, view_graph_, model_,
                                        options_.extension.resection, context_);
  const int pass = summary_.num_passes + 1;
  int num_added = 0;
  left_.clear();
  is_of_last_pass_.assign(scene_.frames.size(), false);
  for (const ResectedFrame& frame : result.frames) {
    if (!frame.is_added) {
      left_.push_back(frame);
      continue;
    }
    ++num_added;
    is_of_last_pass_[frame.frame_idx] = true;
    summary_.added_frames.push_back({pass, frame});
  }
  if (num_added == 0 && result.sensors.empty()) return false;
  summary_.num_passes = pass;
  summary_.placed_sensors.insert(summary_.placed_sensors.end(),
                                 result.sensors.begin(), result.sensors.end());
  context_.Info("pass " + std::to_string(pass) + ": " +
                std::to_string(num_added) + " frames added, " +
                std::to_string(left_.size()) + " left");
  model_ = TriangulateCandidates(scene_, candidates_, result.estimate,
                                 options_.bundle_adjustment, context_);
  return true;
}

std::vector<size_t> FrameAdder::PointsOfLastPass() const {
  std::vector<size_t> point_idxs;
  for (size_t i = 0; i < model_.points.size(); ++i) {
    const std::vector<Observation>& track = model_.points[i].track;
    if (std::any_of(track.begin(), track.end(), [this](const Observation& o) {
          return is_of_last_pass_[scene_.images[o.image_idx].frame_idx];
        })) {
      point_idxs.push_back(i);
    }
  }
  return point_idxs;
}

// With all other frames, all sensors of the given model and intrinsics held.
void FrameAdder::RefineLastPass() {
  FixedPoses held;
  for (const char is_of_last_pass : is_of_last_pass_) {
    held.frames.push_back(!is_of_last_pass);
  }
  for (const auto& pose : start_.sensor_from_rig) {
    held.sensors.push_back(pose.has_value());
  }
  BundleAdjustmentOptions options = options_.bundle_adjustment;
  options.refine_focal_length = RefineMode::kNo;
  options.refine_principal_point = false;
  options.refine_extra_params = RefineMode::kNo;

  const std::vector<size_t> point_idxs = PointsOfLastPass();
  Reconstruction part{
      model_.cameras, model_.sensor_from_rig, model_.rig_from_world, {}};
  for (const size_t i : point_idxs) part.points.push_back(model_.points[i]);
  if (part.points.empty()) return;
  const BundleResult result =
      AdjustBundle(scene_, part, options, context_, {}, held);
  model_.sensor_from_rig = result.estimate.sensor_from_rig;
  model_.rig_from_world = result.estimate.rig_from_world;
  for (size_t k = 0; k < point_idxs.size(); ++k) {
    model_.points[point_idxs[k]] = result.estimate.points[k];
  }
}

FixedPoses HoldAllOf(const Reconstruction& model) {
  FixedPoses held;
  for (const auto& pose : model.rig_from_world) {
    held.frames.push_back(pose.has_value());
  }
  for (const auto& pose : model.sensor_from_rig) {
    held.sensors.push_back(pose.has_value());
  }
  return held;
}

bool HasGivenLength(const Sensor& sensor) {
  return sensor.sensor_from_rig &&
         !sensor.sensor_from_rig->translation.isZero(0.0);
}

// Whether given poses of sensors determine the unit of length of the model.
bool IsMetric(const Scene& scene, const Reconstruction& start) {
  for (size_t i = 0; i < scene.sensors.size(); ++i) {
    if (start.sensor_from_rig[i] && HasGivenLength(scene.sensors[i])) {
      return true;
    }
  }
  return false;
}

// A given rig that is not in the model may have another unit of length. Then
// its frames would hardly fit, and bend the model. So its sensors are placed as
// if nothing was given, and given lengths become those that they have there.
// nullopt if there is no such rig.
std::optional<Scene> AdaptGivenLengths(const Scene& scene,
                                       const Bearings& bearings,
                                       const ViewGraph& view_graph,
                                       const Reconstruction& start,
                                       const ResectionOptions& options,
                                       const Context& context) {
  constexpr double kMaxFactor = 1.1;  // of errors of the lengths
  Scene without = scene;
  for (size_t i = 0; i < scene.sensors.size(); ++i) {
    const int ref_idx = scene.rigs[scene.sensors[i].rig_idx].ref_sensor_idx;
    if (start.sensor_from_rig[ref_idx]) continue;
    if (!HasGivenLength(scene.sensors[i])) continue;
    without.sensors[i].sensor_from_rig.reset();
  }
  std::vector<std::vector<double>> factors(scene.rigs.size());
  const ResectionResult placed =
      ResectFrames(without, bearings, view_graph, start, options, context);
  for (const PlacedSensor& sensor : placed.sensors) {
    const Sensor& given = scene.sensors[sensor.sensor_idx];
    if (!HasGivenLength(given)) continue;
    factors[given.rig_idx].push_back(
        placed.estimate.sensor_from_rig[sensor.sensor_idx]->translation.norm() /
        given.sensor_from_rig->translation.norm());
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
    context.Warning("the given lengths in the rig of camera '" +
                    scene.sensors[rig.ref_sensor_idx].name + "' are " +
                    std::to_string(factor) +
                    " times as long in the model, whose unit is kept");
  }
  return adapted;
}

bool HasNewGivenRig(const Scene& scene, const Reconstruction& start) {
  return std::any_of(
      scene.sensors.begin(), scene.sensors.end(), [&](const Sensor& sensor) {
        const int ref_idx = scene.rigs[sensor.rig_idx].ref_sensor_idx;
        return HasGivenLength(sensor) && !start.sensor_from_rig[ref_idx];
      });
}

std::string WhyNotAdded(const ResectedFrame& frame,
                        const ResectionOptions& options) {
  if (frame.num_images == 0) {
    return "the poses of its cameras in the rig are not known, as no image of "
           "them sees enough points of the model";
  }
  const std::string num_keypoints = std::to_string(frame.num_keypoints);
  if (frame.num_keypoints < options.abs_pose_min_num_inliers) {
    return "only " + num_keypoints +
           " of its keypoints are matched to points of the model";
  }
  return "only " + std::to_string(frame.num_inliers) + " of its " +
         num_keypoints + " keypoints that see points agree on its pose";
}

void ListUnregistered(const Scene& scene, const FrameAdder& adder,
                      const MapperOptions& options, const Context& context,
                      const MapperModel& model, MapperResult* result) {
  std::vector<std::string> reasons(scene.frames.size());
  for (const ResectedFrame& frame : adder.left()) {
    reasons[frame.frame_idx] = WhyNotAdded(frame, options.extension.resection);
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
                    "' are not in the model, as too few of them see enough of "
                    "its points to tell where the camera is in its rig");
  }
}

}  // namespace

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
      rotation.message = "the reference";
    } else if (num_frames[i] > 0) {
      rotation.message = "from resections of single images";
    } else if (start.sensor_from_rig[i]) {
      rotation.message = "from the given model";
    } else if (rotation.is_observable) {
      rotation.message = "given";
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

void ExtendModel(const Scene& given_scene, const Bearings& bearings,
                 const ViewGraph& view_graph, const Reconstruction& start,
                 const MapperOptions& options, const Context& context,
                 const PositionPriors& priors, const GravityPriors& gravity,
                 MapperResult* result) {
  std::optional<Scene> adapted;
  if (HasNewGivenRig(given_scene, start)) {
    adapted = AdaptGivenLengths(given_scene, bearings, view_graph, start,
                                options.extension.resection, context);
  }
  const Scene& scene = adapted ? *adapted : given_scene;
  const bool are_fixed = options.extension.fix_existing_frames;
  if (are_fixed && !priors.IsEmpty()) {
    throw Error(
        "--Mapper.fix_existing_frames holds the model where it is, and "
        "measured positions would move it; leave one of them out");
  }
  if (are_fixed && options.soft_rig.method != SoftRig::kNone) {
    throw Error(
        "--Mapper.fix_existing_frames holds images where they are, and "
        "--SoftRig.method would move them; leave one of them out");
  }
  MapperModel model;
  AdjustmentInput input{scene, view_graph, priors, gravity};
  input.pair_is_used.assign(view_graph.pairs.size(), true);
  input.is_metric = IsMetric(scene, start);
  input.start = &start;
  if (are_fixed) input.held = HoldAllOf(start);
  const CandidateSource candidates = MakeCandidateSource(
      scene, view_graph, input.pair_is_used, options, context);
  FrameAdder adder(scene, bearings, view_graph, start, candidates, options,
                   context);
  Reconstruction initial =
      Timed("resection", context, &model.times, [&] { return adder.Run(); });
  model.extension = adder.summary();
  model.extension->frames_are_fixed = are_fixed;
  model.extension->num_existing_frames = static_cast<int>(std::count_if(
      start.rig_from_world.begin(), start.rig_from_world.end(),
      [](const std::optional<Rigid3>& pose) { return pose.has_value(); }));
  model.num_frames_in_component = static_cast<int>(scene.frames.size());
  AdjustModel(input, options, context, std::move(initial), &model);
  DescribeSensors(scene, start, model.extension->placed_sensors, &model,
                  result);
  ListUnregistered(scene, adder, options, context, model, result);
  WarnOfSensors(scene, model.reconstruction, context);
  if (!model.reconstruction.points.empty()) {
    result->models.push_back(std::move(model));
  }
}

}  // namespace mgsfm

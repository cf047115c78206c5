// SPDX-License-Identifier: BSD-3-Clause
#include "registration/frame_addition.h"

#include <cstddef>
#include <string>

#include "base/ranges.h"
#include "math/statistics.h"
#include "mgsfm/base/mask.h"

namespace mgsfm {
namespace {

// The fixed input of all passes.
struct PassInput : FrameAdditionInput {
  const CandidateSource& candidates;
  const ResectionOptions& resection;
  const BundleAdjustmentOptions& options;
  const Context& context;
};

// Indices of the points that frames of the mask observe.
std::vector<size_t> PointsSeenBy(const Mask& frame_is_new, const Scene& scene,
                                 const Reconstruction& model) {
  std::vector<size_t> point_idxs;
  for (size_t i = 0; i < model.points.size(); ++i) {
    const std::vector<Observation>& track = model.points[i].track;
    if (AnyOf(track, [&](const Observation& o) {
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
  BundleAdjustmentOptions options = input.options;
  options.HoldIntrinsics();

  const std::vector<size_t> point_idxs =
      PointsSeenBy(frame_is_new, input.scene, *model);
  if (point_idxs.empty()) return;
  Reconstruction seen{model->cameras,
                      model->sensor_from_rig,
                      model->rig_from_world,
                      model->motions,
                      {}};
  for (const size_t i : point_idxs) seen.points.push_back(model->points[i]);
  const BundleResult result =
      AdjustBundle(input.scene, seen, options, input.context, {}, fixed);
  model->sensor_from_rig = result.estimate.sensor_from_rig;
  model->rig_from_world = result.estimate.rig_from_world;
  for (size_t k = 0; k < point_idxs.size(); ++k) {
    model->points[point_idxs[k]] = result.estimate.points[k];
  }
}

// Resects the frames without a pose. Returns the mask of added frames, or
// nullopt if neither a frame nor a sensor was added.
std::optional<Mask> AddPass(const PassInput& input, ExtendedModel* extended) {
  const ResectionResult result =
      ResectFrames(input.scene, input.bearings, input.view_graph,
                   extended->model, input.resection, input.context);
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
                            input.options, input.context);
  return frame_is_new;
}

bool HasNewKnownRig(const Scene& scene, const Reconstruction& start) {
  return AnyOf(scene.sensors, [&](const Sensor& sensor) {
    const int ref_idx = scene.rigs[sensor.rig_idx].ref_sensor_idx;
    return HasKnownLength(sensor) && !start.sensor_from_rig[ref_idx];
  });
}

}  // namespace

ExtendedModel AddFrames(
    const FrameAdditionInput& input, const CandidateSource& candidates,
    const ResectionOptions& resection, const BundleAdjustmentOptions& options,
    const Context& context,
    const std::function<void(const Reconstruction&)>& observer) {
  const PassInput pass{input, candidates, resection, options, context};
  ExtendedModel extended{input.start, {}, {}};
  while (const std::optional<Mask> frame_is_new = AddPass(pass, &extended)) {
    RefineNewFrames(pass, *frame_is_new, &extended.model);
    if (observer) observer(extended.model);
  }
  return extended;
}

bool HasKnownLength(const Sensor& sensor) {
  return sensor.sensor_from_rig &&
         !sensor.sensor_from_rig->translation.isZero(0.0);
}

std::optional<Scene> AdaptKnownLengths(const FrameAdditionInput& input,
                                       const ResectionOptions& options,
                                       const Context& context) {
  const auto& [scene, bearings, view_graph, start] = input;
  if (!HasNewKnownRig(scene, start)) return std::nullopt;
  constexpr double kMaxFactor = 1.1;  // errors of lengths stay below 10 %
  Scene uncalibrated = scene;
  for (size_t i = 0; i < scene.sensors.size(); ++i) {
    const int ref_idx = scene.rigs[scene.sensors[i].rig_idx].ref_sensor_idx;
    if (start.sensor_from_rig[ref_idx]) continue;
    if (!HasKnownLength(scene.sensors[i])) continue;
    uncalibrated.sensors[i].sensor_from_rig.reset();
  }
  std::vector<std::vector<double>> factors(scene.rigs.size());
  const ResectionResult placed =
      ResectFrames(uncalibrated, bearings, view_graph, start, options, context);
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

}  // namespace mgsfm

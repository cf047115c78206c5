// SPDX-License-Identifier: BSD-3-Clause
#include "registration/known_lengths.h"

#include <cstddef>
#include <string>

#include "base/ranges.h"
#include "math/statistics.h"

namespace mgsfm {
namespace {

bool HasNewKnownRig(const Scene& scene, const Reconstruction& start) {
  return AnyOf(scene.sensors, [&](const Sensor& sensor) {
    const int ref_idx = scene.rigs[sensor.rig_idx].ref_sensor_idx;
    return HasKnownLength(sensor) && !start.sensor_from_rig[ref_idx];
  });
}

}  // namespace

bool HasKnownLength(const Sensor& sensor) {
  return sensor.sensor_from_rig &&
         !sensor.sensor_from_rig->translation.isZero(0.0);
}

std::optional<Scene> AdaptKnownLengths(const KnownLengthsInput& input,
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

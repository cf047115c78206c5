// SPDX-License-Identifier: BSD-3-Clause
#include "georegistration/metric_scale.h"

#include <charconv>
#include <cmath>

#include "base/text.h"
#include "mgsfm/base/error.h"

namespace mgsfm {
namespace {

constexpr char kPrefix[] = "known_baseline=";

[[noreturn]] void Throw(const std::string& text, const std::string& problem) {
  throw Error("metric_scale '" + text + "': " + problem);
}

std::vector<std::pair<int, int>> FindSensors(const Scene& scene,
                                             const std::string& name1,
                                             const std::string& name2) {
  std::vector<std::pair<int, int>> found;
  for (const Rig& rig : scene.rigs) {
    std::optional<int> sensor1, sensor2;
    for (const int sensor_idx : rig.sensor_idxs) {
      if (scene.sensors[sensor_idx].name == name1) sensor1 = sensor_idx;
      if (scene.sensors[sensor_idx].name == name2) sensor2 = sensor_idx;
    }
    if (sensor1 && sensor2 && *sensor1 != *sensor2) {
      found.emplace_back(*sensor1, *sensor2);
    }
  }
  return found;
}

std::string SensorNames(const Scene& scene) {
  std::string names;
  for (const Sensor& sensor : scene.sensors) {
    names += (names.empty() ? "'" : ", '") + sensor.name + "'";
  }
  return names;
}

void CheckKnownPoses(const std::string& text, const KnownBaseline& baseline,
                     const Scene& scene) {
  for (const auto& [sensor1, sensor2] : baseline.sensor_idxs) {
    const auto& pose1 = scene.sensors[sensor1].sensor_from_rig;
    const auto& pose2 = scene.sensors[sensor2].sensor_from_rig;
    if (!pose1 || !pose2) continue;
    const double known = (pose1->Center() - pose2->Center()).norm();
    // The error of a baseline of 0.3 m that was measured to 3 mm.
    if (std::abs(known - baseline.length_m) > 0.01 * baseline.length_m) {
      Throw(text, "the known rig has the distance " +
                      FormatDouble(known, std::chars_format::general, 6) +
                      "; correct one of them, or do not give the poses");
    }
  }
}

}  // namespace

std::optional<KnownBaseline> ParseMetricScale(const std::string& text,
                                              const Scene& scene) {
  if (text.empty()) return std::nullopt;
  const size_t begin = sizeof(kPrefix) - 1;
  const size_t second = text.rfind(':');
  const size_t first =
      second == std::string::npos ? second : text.rfind(':', second - 1);
  if (text.compare(0, begin, kPrefix) != 0 || first == std::string::npos ||
      first < begin || first == second) {
    Throw(text, "give known_baseline=CAMERA1:CAMERA2:METERS");
  }
  const auto length_m = ParseDouble(text.substr(second + 1));
  if (!length_m || !(*length_m > 0.0)) {
    Throw(text, "the last part is not a positive number of meters");
  }
  KnownBaseline baseline{
      FindSensors(scene, text.substr(begin, first - begin),
                  text.substr(first + 1, second - first - 1)),
      *length_m};
  if (baseline.sensor_idxs.empty()) {
    Throw(text,
          "no rig has both cameras; the cameras are " + SensorNames(scene));
  }
  CheckKnownPoses(text, baseline, scene);
  return baseline;
}

std::optional<double> MetersPerUnit(const KnownBaseline& baseline,
                                    const Reconstruction& model) {
  double sum = 0.0;
  int count = 0;
  for (const auto& [sensor1, sensor2] : baseline.sensor_idxs) {
    const auto& pose1 = model.sensor_from_rig[sensor1];
    const auto& pose2 = model.sensor_from_rig[sensor2];
    if (!pose1 || !pose2) continue;
    sum += (pose1->Center() - pose2->Center()).norm();
    ++count;
  }
  if (!(sum > 0.0)) return std::nullopt;
  return baseline.length_m * count / sum;
}

}  // namespace mgsfm

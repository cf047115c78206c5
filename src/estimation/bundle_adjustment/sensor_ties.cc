// SPDX-License-Identifier: BSD-3-Clause
#include "bundle_adjustment/sensor_ties.h"

#include <algorithm>
#include <cstddef>
#include <map>
#include <set>
#include <utility>
#include <vector>

#include "math/union_find.h"

namespace mgsfm {
namespace {

int SensorOf(const Scene& scene, const Observation& observation) {
  return scene.images[observation.image_idx].sensor_idx;
}

UnionFind TiedSensors(const Scene& scene, const std::vector<Point3D>& points) {
  std::map<std::pair<int, int>, int> num_shared;
  for (const Point3D& point : points) {
    std::set<int> sensors;
    for (const Observation& o : point.track) {
      sensors.insert(SensorOf(scene, o));
    }
    for (auto a = sensors.begin(); a != sensors.end(); ++a) {
      for (auto b = std::next(a); b != sensors.end(); ++b) {
        ++num_shared[{*a, *b}];
      }
    }
  }
  UnionFind tied(scene.sensors.size());
  for (const auto& [sensors, number] : num_shared) {
    if (number >= kMinNumSensorTies) tied.Union(sensors.first, sensors.second);
  }
  return tied;
}

}  // namespace

void SeparateUntiedSensors(const Scene& scene, Reconstruction* reconstruction) {
  std::vector<Point3D>& points = reconstruction->points;
  UnionFind tied = TiedSensors(scene, points);
  for (Point3D& point : points) {
    std::map<size_t, int> num_observations;  // of sets of tied sensors
    for (const Observation& o : point.track) {
      ++num_observations[tied.Find(SensorOf(scene, o))];
    }
    if (num_observations.size() == 1) continue;
    const size_t most =
        std::max_element(
            num_observations.begin(), num_observations.end(),
            [](const auto& a, const auto& b) { return a.second < b.second; })
            ->first;
    point.track.erase(std::remove_if(point.track.begin(), point.track.end(),
                                     [&](const Observation& o) {
                                       return tied.Find(SensorOf(scene, o)) !=
                                              most;
                                     }),
                      point.track.end());
  }
  points.erase(std::remove_if(
                   points.begin(), points.end(),
                   [](const Point3D& point) { return point.track.size() < 2; }),
               points.end());
}

}  // namespace mgsfm

// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <Eigen/Geometry>
#include <algorithm>
#include <limits>
#include <vector>

#include "geometry/so3.h"
#include "mgsfm/scene/estimates.h"
#include "mgsfm/simulator/simulation.h"

namespace mgsfm {

inline SimulationOptions SmallSimulation() {
  SimulationOptions options;
  options.num_frames = 24;
  options.num_points_per_frame = 100;
  options.max_num_features_per_image = 150;
  return options;
}

// The largest error of the sensor_from_rig rotations that were estimated.
inline double MaxSensorErrorDeg(const Simulation& simulation,
                                const RotationEstimate& estimate) {
  double max = 0.0;
  for (size_t k = 0; k < estimate.sensor_from_rig.size(); ++k) {
    if (!estimate.sensor_from_rig[k]) continue;
    max = std::max(
        max,
        AngleBetween(*estimate.sensor_from_rig[k],
                     simulation.ground_truth.sensor_from_rig[k]->rotation));
  }
  return RadToDeg(max);
}

// The largest error of the frames of one component after rotating its world by
// the best of the rotations that align one frame each.
inline double MaxFrameErrorDeg(const Simulation& simulation,
                               const RotationEstimate& estimate,
                               int component = 0) {
  std::vector<Eigen::Quaterniond> truth, estimated;
  for (size_t f = 0; f < estimate.rig_from_world.size(); ++f) {
    if (estimate.component[f] != component) continue;
    truth.push_back(simulation.ground_truth.rig_from_world[f]->rotation);
    estimated.push_back(*estimate.rig_from_world[f]);
  }
  double best = std::numeric_limits<double>::infinity();
  for (size_t ref = 0; ref < truth.size(); ++ref) {
    const Eigen::Quaterniond world = truth[ref].conjugate() * estimated[ref];
    double max = 0.0;
    for (size_t i = 0; i < truth.size(); ++i) {
      max = std::max(max, AngleBetween(estimated[i], truth[i] * world));
    }
    best = std::min(best, RadToDeg(max));
  }
  return best;
}

inline int NumFramesWithRotation(const RotationEstimate& estimate) {
  return static_cast<int>(std::count_if(
      estimate.rig_from_world.begin(), estimate.rig_from_world.end(),
      [](const auto& rotation) { return rotation.has_value(); }));
}

// Keeps the pairs of images a, b for which keep(a, b) is true.
template <class Predicate>
void KeepPairs(Simulation* simulation, const Predicate& keep) {
  auto& pairs = simulation->view_graph.pairs;
  pairs.erase(std::remove_if(pairs.begin(), pairs.end(),
                             [&](const ImagePair& pair) {
                               const auto& images = simulation->scene.images;
                               return !keep(images[pair.image_idx1],
                                            images[pair.image_idx2]);
                             }),
              pairs.end());
}

}  // namespace mgsfm

// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <algorithm>
#include <map>
#include <utility>
#include <vector>

#include "mgsfm/base/mask.h"
#include "mgsfm/scene/estimates.h"
#include "mgsfm/scene/scene.h"
#include "mgsfm/simulator/simulation.h"

namespace mgsfm {

// Removes the frames with is_removed(frame_idx) from a model, their
// observations, points with fewer than two remaining observations, and the
// poses of sensors in rigs without remaining frames.
template <class Predicate>
Reconstruction WithoutFrames(const Scene& scene, Reconstruction model,
                             const Predicate& is_removed) {
  Mask rig_is_left(scene.rigs.size(), false);
  for (size_t i = 0; i < scene.frames.size(); ++i) {
    if (is_removed(static_cast<int>(i))) {
      model.rig_from_world[i].reset();
    } else if (model.rig_from_world[i]) {
      rig_is_left[scene.frames[i].rig_idx] = true;
    }
  }
  for (size_t i = 0; i < scene.sensors.size(); ++i) {
    if (!rig_is_left[scene.sensors[i].rig_idx]) {
      model.sensor_from_rig[i].reset();
    }
  }
  for (Point3D& point : model.points) {
    point.track.erase(std::remove_if(point.track.begin(), point.track.end(),
                                     [&](const Observation& o) {
                                       return !model.IsRegistered(scene,
                                                                  o.image_idx);
                                     }),
                      point.track.end());
  }
  model.points.erase(std::remove_if(model.points.begin(), model.points.end(),
                                    [](const Point3D& point) {
                                      return point.track.size() < 2;
                                    }),
                     model.points.end());
  return model;
}

// Moves the sensors from `first_sensor` on from the single rig of a simulation
// to a second rig with separate frames and unknown poses, as if recorded at
// another time. The first moved sensor is the reference.
inline void SplitRig(int first_sensor, Simulation* simulation) {
  Scene& scene = simulation->scene;
  Reconstruction& truth = simulation->ground_truth;
  const auto is_second = [&](int sensor_idx) {
    return sensor_idx >= first_sensor;
  };
  scene.rigs[0].sensor_idxs.clear();
  scene.rigs.push_back({RigId(scene.rigs[0].id.value() + 1), first_sensor, {}});
  const Rigid3 second_from_first = *truth.sensor_from_rig[first_sensor];
  for (size_t i = 0; i < scene.sensors.size(); ++i) {
    const int sensor_idx = static_cast<int>(i);
    Sensor& sensor = scene.sensors[i];
    sensor.rig_idx = is_second(sensor_idx) ? 1 : 0;
    scene.rigs[sensor.rig_idx].sensor_idxs.push_back(sensor_idx);
    if (!is_second(sensor_idx)) continue;
    truth.sensor_from_rig[i] =
        *truth.sensor_from_rig[i] * second_from_first.Inverse();
    sensor.sensor_from_rig.reset();
  }
  scene.sensors[first_sensor].sensor_from_rig = Rigid3();
  truth.sensor_from_rig[first_sensor] = Rigid3();

  const std::vector<Frame> old_frames = std::move(scene.frames);
  const auto old_poses = std::move(truth.rig_from_world);
  scene.frames.clear();
  truth.rig_from_world.clear();
  std::map<std::pair<int, int>, int> frame_idxs;  // by old frame and rig
  for (size_t i = 0; i < scene.images.size(); ++i) {
    Image& image = scene.images[i];
    const int rig_idx = scene.sensors[image.sensor_idx].rig_idx;
    const int old_idx = image.frame_idx;
    const auto [found, is_new] =
        frame_idxs.emplace(std::make_pair(old_idx, rig_idx),
                           static_cast<int>(scene.frames.size()));
    if (is_new) {
      Frame frame = old_frames[old_idx];
      frame.id = FrameId(image.id.value());
      frame.name += rig_idx == 0 ? "" : " of the second rig";
      frame.rig_idx = rig_idx;
      frame.image_idxs.clear();
      scene.frames.push_back(std::move(frame));
      truth.rig_from_world.push_back(rig_idx == 0 ? *old_poses[old_idx]
                                                  : second_from_first *
                                                        *old_poses[old_idx]);
    }
    image.frame_idx = found->second;
    scene.frames[found->second].image_idxs.push_back(static_cast<int>(i));
  }
}

}  // namespace mgsfm

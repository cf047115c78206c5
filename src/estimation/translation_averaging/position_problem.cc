// SPDX-License-Identifier: BSD-3-Clause
#include "translation_averaging/position_problem.h"

#include <algorithm>

#include "base/ranges.h"

namespace mgsfm {

bool PositionProblem::HasKnownOffset() const {
  return AnyOf(fixed_translation,
               [](const Eigen::Vector3d& t) { return !t.isZero(0.0); });
}

Mask PositionProblem::FramesWithRotation() const {
  Mask has_rotation(num_frames, false);
  for (size_t i = 0; i < frame_idx.size(); ++i) {
    if (IsUsed(static_cast<int>(i))) has_rotation[frame_idx[i]] = true;
  }
  return has_rotation;
}

PositionProblem MakePositionProblem(const Scene& scene,
                                    const RotationEstimate& rotations) {
  PositionProblem problem;
  const size_t num_sensors = scene.sensors.size();
  problem.num_frames = static_cast<int>(scene.frames.size());
  problem.sensor_kind.assign(num_sensors, SensorKind::kAbsent);
  problem.fixed_translation.assign(num_sensors, Eigen::Vector3d::Zero());
  for (size_t i = 0; i < scene.images.size(); ++i) {
    const Image& image = scene.images[i];
    problem.frame_idx.push_back(image.frame_idx);
    problem.sensor_idx.push_back(image.sensor_idx);
    problem.world_from_cam.emplace_back();
    const auto cam_from_world =
        rotations.CamFromWorld(scene, static_cast<int>(i));
    if (!cam_from_world) continue;
    problem.world_from_cam.back() =
        cam_from_world->conjugate().toRotationMatrix();
    problem.sensor_kind[image.sensor_idx] = SensorKind::kFree;
  }
  for (size_t i = 0; i < num_sensors; ++i) {
    const bool is_reference = scene.IsReference(static_cast<int>(i));
    const auto& known = scene.sensors[i].sensor_from_rig;
    if (!is_reference && !known) continue;
    problem.sensor_kind[i] = SensorKind::kFixed;
    if (!is_reference) problem.fixed_translation[i] = known->translation;
  }
  return problem;
}

}  // namespace mgsfm

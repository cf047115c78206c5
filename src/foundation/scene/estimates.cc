// SPDX-License-Identifier: BSD-3-Clause
#include "mgsfm/scene/estimates.h"

#include <utility>

#include "base/ranges.h"
#include "mgsfm/base/error.h"

namespace mgsfm {

std::optional<Eigen::Quaterniond> RotationEstimate::CamFromWorld(
    const Scene& scene, int image_idx) const {
  const Image& image = scene.images[image_idx];
  const auto& sensor = sensor_from_rig[image.sensor_idx];
  const auto& frame = rig_from_world[image.frame_idx];
  if (!sensor || !frame) return std::nullopt;
  return *sensor * *frame;
}

std::optional<Rigid3> Reconstruction::CamFromWorld(const Scene& scene,
                                                   int image_idx) const {
  const Image& image = scene.images[image_idx];
  const auto& sensor = sensor_from_rig[image.sensor_idx];
  const auto& frame = rig_from_world[image.frame_idx];
  if (!sensor || !frame) return std::nullopt;
  if (motions.empty()) return *sensor * *frame;
  return *sensor * Move(*frame, motions[image_idx]);
}

bool Reconstruction::IsRegistered(const Scene& scene, int image_idx) const {
  const Image& image = scene.images[image_idx];
  return sensor_from_rig[image.sensor_idx].has_value() &&
         rig_from_world[image.frame_idx].has_value();
}

int Reconstruction::NumRegisteredImages(const Scene& scene) const {
  return static_cast<int>(
      CountIf(Indices(scene.images.size()),
              [&](int image_idx) { return IsRegistered(scene, image_idx); }));
}

void TransformWorld(const Sim3& new_from_old, Reconstruction* reconstruction) {
  for (std::optional<Rigid3>& pose : reconstruction->sensor_from_rig) {
    if (pose) pose->translation *= new_from_old.scale;
  }
  for (std::optional<Rigid3>& pose : reconstruction->rig_from_world) {
    if (pose) pose = TransformWorld(new_from_old, *pose);
  }
  for (RigMotion& motion : reconstruction->motions) {
    motion.shift_in_world =
        new_from_old.scale * (new_from_old.rotation * motion.shift_in_world);
  }
  for (Point3D& point : reconstruction->points) {
    point.point_in_world = new_from_old * point.point_in_world;
  }
}

Reconstruction SeparateImages(
    const Reconstruction& reconstruction,
    std::vector<std::optional<Rigid3>> cam_from_world) {
  Reconstruction separate;
  separate.cameras = reconstruction.cameras;
  separate.sensor_from_rig.assign(reconstruction.sensor_from_rig.size(),
                                  Rigid3());
  separate.rig_from_world = std::move(cam_from_world);
  separate.points = reconstruction.points;
  return separate;
}

Reconstruction JoinEstimates(const Scene& scene,
                             const RotationEstimate& rotations,
                             const PositionEstimate& positions,
                             const ObservationGroups& tracks) {
  MGSFM_CHECK_EQ(positions.point_in_world.size(), tracks.size());
  Reconstruction reconstruction;
  reconstruction.cameras = scene.cameras;
  reconstruction.sensor_from_rig.resize(scene.sensors.size());
  for (size_t i = 0; i < scene.sensors.size(); ++i) {
    const auto& rotation = rotations.sensor_from_rig[i];
    const auto& translation = positions.sensor_from_rig_translation[i];
    if (rotation && translation) {
      reconstruction.sensor_from_rig[i] = Rigid3{*rotation, *translation};
    }
  }
  reconstruction.rig_from_world.resize(scene.frames.size());
  for (size_t i = 0; i < scene.frames.size(); ++i) {
    const auto& rotation = rotations.rig_from_world[i];
    const auto& center = positions.frame_center_in_world[i];
    if (rotation && center) {
      reconstruction.rig_from_world[i] =
          Rigid3::FromRotationAndCenter(*rotation, *center);
    }
  }
  for (size_t track_idx = 0; track_idx < tracks.size(); ++track_idx) {
    if (!positions.point_in_world[track_idx]) continue;
    Point3D point;
    point.point_in_world = *positions.point_in_world[track_idx];
    for (const Observation* o = tracks.begin(track_idx);
         o != tracks.end(track_idx); ++o) {
      if (reconstruction.IsRegistered(scene, o->image_idx)) {
        point.track.push_back(*o);
      }
    }
    if (point.track.size() >= 2) {
      reconstruction.points.push_back(std::move(point));
    }
  }
  return reconstruction;
}

}  // namespace mgsfm

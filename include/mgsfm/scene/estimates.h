// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <Eigen/Core>
#include <Eigen/Geometry>
#include <optional>
#include <vector>

#include "mgsfm/base/mask.h"
#include "mgsfm/geometry/rigid3.h"
#include "mgsfm/scene/scene.h"
#include "mgsfm/scene/tracks.h"

namespace mgsfm {

// What stages estimate. nullopt means "not estimated", never a default pose.

struct RotationEstimate {
  std::vector<std::optional<Eigen::Quaterniond>> rig_from_world;   // per frame
  std::vector<std::optional<Eigen::Quaterniond>> sensor_from_rig;  // per sensor
  // Per pair of the view graph: used, and consistent with the estimate.
  Mask pair_is_inlier;
  // Per frame: which connected part it is in, by the pairs that are inliers;
  // nullopt for frames without rotation. Parts are numbered by descending
  // number of frames, then by first frame. Each part has its own world.
  std::vector<std::optional<int>> component;

  // sensor_from_rig * rig_from_world, if both are known.
  std::optional<Eigen::Quaterniond> CamFromWorld(const Scene& scene,
                                                 int image_idx) const;
};

// Positions in one connected part, in one common unit of length.
struct PositionEstimate {
  std::vector<std::optional<Eigen::Vector3d>> frame_center_in_world;
  // Translation of sensor_from_rig, per sensor.
  std::vector<std::optional<Eigen::Vector3d>> sensor_from_rig_translation;
  // Per track of Tracks::tracks.
  std::vector<std::optional<Eigen::Vector3d>> point_in_world;
};

struct Point3D {
  Eigen::Vector3d point_in_world = Eigen::Vector3d::Zero();
  Eigen::Matrix<uint8_t, 3, 1> color = Eigen::Matrix<uint8_t, 3, 1>::Zero();
  std::optional<double> error_px;  // mean reprojection error
  std::vector<Observation> track;
};

// A model of one connected part. Positions in the arrays are those of Scene.
struct Reconstruction {
  std::vector<Camera> cameras;
  std::vector<std::optional<Rigid3>> sensor_from_rig;  // per sensor
  std::vector<std::optional<Rigid3>> rig_from_world;   // per frame
  std::vector<Point3D> points;

  // sensor_from_rig * rig_from_world, if both are known.
  std::optional<Rigid3> CamFromWorld(const Scene& scene, int image_idx) const;
  bool IsRegistered(const Scene& scene, int image_idx) const;
};

// Moves the world of a model. Frame poses, internal translations and points
// are scaled alike.
void TransformWorld(const Sim3& new_from_old, Reconstruction* reconstruction);

// The model for SeparateImages(scene) whose images have the given poses; points
// and cameras stay.
Reconstruction SeparateImages(
    const Reconstruction& reconstruction,
    std::vector<std::optional<Rigid3>> cam_from_world);

// Joins rotations and positions to a model whose points have the observations
// of `tracks` that lie in registered images.
Reconstruction JoinEstimates(const Scene& scene,
                             const RotationEstimate& rotations,
                             const PositionEstimate& positions,
                             const ObservationGroups& tracks);

}  // namespace mgsfm

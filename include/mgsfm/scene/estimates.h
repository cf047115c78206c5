// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <Eigen/Core>
#include <Eigen/Geometry>
#include <cstddef>
#include <optional>
#include <vector>

#include "mgsfm/base/mask.h"
#include "mgsfm/geometry/rigid3.h"
#include "mgsfm/scene/scene.h"

namespace mgsfm {

// One keypoint of one image.
struct Observation {
  int image_idx;
  int keypoint_idx;

  friend bool operator==(const Observation& a, const Observation& b) {
    return a.image_idx == b.image_idx && a.keypoint_idx == b.keypoint_idx;
  }
  friend bool operator<(const Observation& a, const Observation& b) {
    return a.image_idx != b.image_idx ? a.image_idx < b.image_idx
                                      : a.keypoint_idx < b.keypoint_idx;
  }
};

// Groups of observations in flat arrays: the sorted observations of group g are
// observations[offsets[g]] to observations[offsets[g + 1] - 1].
struct ObservationGroups {
  std::vector<Observation> observations;
  std::vector<size_t> offsets = {0};

  size_t size() const { return offsets.size() - 1; }
  const Observation* begin(size_t group) const {
    return observations.data() + offsets[group];
  }
  const Observation* end(size_t group) const {
    return observations.data() + offsets[group + 1];
  }
  size_t length(size_t group) const {
    return offsets[group + 1] - offsets[group];
  }
  // Makes a group of the observations appended since the last call.
  void FinishGroup() { offsets.push_back(observations.size()); }
  void AddGroup(const Observation* begin, const Observation* end) {
    observations.insert(observations.end(), begin, end);
    FinishGroup();
  }
};

// Estimates of the stages. nullopt means "not estimated"; there are no default
// poses.

struct RotationEstimate {
  std::vector<std::optional<Eigen::Quaterniond>> rig_from_world;   // per frame
  std::vector<std::optional<Eigen::Quaterniond>> sensor_from_rig;  // per sensor
  // Per pair of the view graph: the pair is used and agrees with the estimate.
  Mask pair_is_inlier;
  // Per frame: its connected component in the graph of inlier pairs; nullopt
  // for frames without rotation. Components are sorted by descending number of
  // frames, then by first frame. Each component has its own world frame.
  std::vector<std::optional<int>> component;

  // sensor_from_rig * rig_from_world; nullopt unless both are estimated.
  std::optional<Eigen::Quaterniond> CamFromWorld(const Scene& scene,
                                                 int image_idx) const;
};

// Positions in one connected component, in one unit of length.
struct PositionEstimate {
  std::vector<std::optional<Eigen::Vector3d>> frame_center_in_world;
  // Translation of sensor_from_rig, per sensor.
  std::vector<std::optional<Eigen::Vector3d>> sensor_from_rig_translation;
  // Per track.
  std::vector<std::optional<Eigen::Vector3d>> point_in_world;
};

struct Point3D {
  Eigen::Vector3d point_in_world = Eigen::Vector3d::Zero();
  Eigen::Matrix<uint8_t, 3, 1> color = Eigen::Matrix<uint8_t, 3, 1>::Zero();
  std::optional<double> error_px;  // mean reprojection error
  std::vector<Observation> track;
};

// A model of one connected component. Arrays are parallel to those of Scene.
struct Reconstruction {
  std::vector<Camera> cameras;
  std::vector<std::optional<Rigid3>> sensor_from_rig;  // per sensor
  std::vector<std::optional<Rigid3>> rig_from_world;   // per frame
  // Per image; empty if all images of a frame are simultaneous.
  std::vector<RigMotion> motions;
  std::vector<Point3D> points;

  // sensor_from_rig * Move(rig_from_world); nullopt unless both are estimated.
  std::optional<Rigid3> CamFromWorld(const Scene& scene, int image_idx) const;
  bool IsRegistered(const Scene& scene, int image_idx) const;
  int NumRegisteredImages(const Scene& scene) const;
};

// Applies a similarity transform to the world frame of a model. The
// translations of frames and sensors and the points are scaled by the same
// factor.
void TransformWorld(const Sim3& new_from_old, Reconstruction* reconstruction);

// The model of SeparateImages(scene) with one frame per image at the pose
// `cam_from_world`. Points and cameras are unchanged.
Reconstruction SeparateImages(
    const Reconstruction& reconstruction,
    std::vector<std::optional<Rigid3>> cam_from_world);

// Combines rotations and positions into a model. Points keep the observations
// of their track in registered images and need at least two of them.
Reconstruction JoinEstimates(const Scene& scene,
                             const RotationEstimate& rotations,
                             const PositionEstimate& positions,
                             const ObservationGroups& tracks);

}  // namespace mgsfm

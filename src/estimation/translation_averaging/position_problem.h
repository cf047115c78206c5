// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <Eigen/Core>
#include <optional>
#include <vector>

#include "mgsfm/base/mask.h"
#include "mgsfm/scene/estimates.h"
#include "mgsfm/scene/scene.h"

namespace mgsfm {

enum class SensorKind {
  kAbsent,  // no image with a rotation
  kFixed,   // reference sensor, or a sensor with known extrinsics
  kFree,    // the translation of sensor_from_rig is estimated
};

// Everything that is constant during translation averaging.
struct PositionProblem {
  // Per image; nullopt if the rotation of its frame or sensor is unknown.
  std::vector<std::optional<Eigen::Matrix3d>> world_from_cam;
  std::vector<int> frame_idx;   // per image
  std::vector<int> sensor_idx;  // per image
  std::vector<SensorKind> sensor_kind;
  // Per sensor: the known translation of a kFixed sensor, zero for others.
  std::vector<Eigen::Vector3d> fixed_translation;
  int num_frames = 0;

  bool IsUsed(int image_idx) const {
    return world_from_cam[image_idx].has_value();
  }
  // A known sensor away from the rig's origin can determine the unit of length.
  bool HasKnownOffset(int sensor_idx) const {
    return !fixed_translation[sensor_idx].isZero(0.0);
  }
  bool HasKnownOffset() const;
  // Per frame: whether it has an image with a rotation.
  Mask FramesWithRotation() const;
};

PositionProblem MakePositionProblem(const Scene& scene,
                                    const RotationEstimate& rotations);

// The unknowns. The camera center of image i is
//   c_i = frame_center[frame] - world_from_cam * sensor_translation[sensor].
struct Positions {
  Mask frame_is_placed;
  std::vector<Eigen::Vector3d> frame_center;
  std::vector<Eigen::Vector3d> sensor_translation;  // of sensor_from_rig

  bool IsPlaced(const PositionProblem& problem, int image_idx) const {
    return problem.IsUsed(image_idx) &&
           frame_is_placed[problem.frame_idx[image_idx]];
  }
  Eigen::Vector3d CamCenter(const PositionProblem& problem,
                            int image_idx) const {
    return frame_center[problem.frame_idx[image_idx]] -
           *problem.world_from_cam[image_idx] *
               sensor_translation[problem.sensor_idx[image_idx]];
  }
};

}  // namespace mgsfm

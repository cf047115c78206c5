// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <Eigen/Geometry>
#include <optional>
#include <string>
#include <vector>

namespace mgsfm {

// The convention of the rotations in a file of poses.
struct PoseConvention {
  bool is_world_from_cam = true;
  enum { kMatrix, kWxyz, kXyzw } order = kXyzw;
};

// The rotation from one image to another, by a model or by matches, and the
// rotations cam_from_world of both as they were read from a file.
struct RotationEvidence {
  Eigen::Quaterniond second_from_first;
  Eigen::Quaterniond first, second;
};

// The convention by which a file agrees with the rotations of `source`, if it
// does not as it was read: another order of quaternions, and inverse poses.
// nullopt if there is none.
std::optional<std::string> FindOtherConvention(
    const std::vector<RotationEvidence>& evidence,
    const PoseConvention& convention, const std::string& source);

}  // namespace mgsfm

// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <cstdint>
#include <optional>
#include <vector>

#include "geometry/absolute_pose.h"
#include "mgsfm/geometry/rigid3.h"
#include "mgsfm/registration/model_extension.h"

namespace mgsfm {

// The pose of a rigid unit (a frame or a single image) and its support.
struct UnitPose {
  std::optional<Rigid3> unit_from_world;
  int num_keypoints = 0;
  int num_inliers = 0;
};

// LO-RANSAC (geometry/absolute_pose.h) with the random numbers of a stream. No
// pose unless its inliers satisfy the options.
[[nodiscard]] UnitPose ResectUnit(const std::vector<CameraPoints>& cameras,
                                  const ResectionOptions& options,
                                  uint64_t seed, uint64_t stream);

}  // namespace mgsfm

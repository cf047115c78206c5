// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <Eigen/Core>
#include <string>
#include <utility>
#include <vector>

#include "mgsfm/scene/scene.h"

namespace mgsfm {

enum class PositionFileFormat {
  kNamed,  // image_name X Y Z
  kKitti,  // 3x4 poses world_from_cam0, one per frame
  kTum,    // timestamp tx ty tz qx qy qz qw
};

// By the first line that is not empty and no comment: 12 or 8 numbers and
// nothing else are poses. Throws Error if the file cannot be read.
PositionFileFormat DetectPositionFormat(const std::string& path);

// Positions of images by their index, of the images of reference sensors (in
// frames without one, of any image). Poses of KITTI are those of the frames in
// the natural order of their names. Those of TUM are interpolated at the times
// of images; images beyond the trajectory, or in a gap of more than ten median
// intervals, get none. Throws Error for malformed lines, another number of
// poses than frames, and images without a time.
std::vector<std::pair<int, Eigen::Vector3d>> ReadTrajectoryPositions(
    const Scene& scene, const std::string& path, PositionFileFormat format);

}  // namespace mgsfm

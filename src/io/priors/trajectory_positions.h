// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <Eigen/Core>
#include <string>
#include <utility>
#include <vector>

#include "mgsfm/geometry/rigid3.h"
#include "mgsfm/scene/scene.h"

namespace mgsfm {

enum class PositionFileFormat {
  kNamed,  // image_name X Y Z
  kKitti,  // 3x4 poses world_from_cam0, one per frame
  kTum,    // timestamp tx ty tz qx qy qz qw
  kEuroc,  // timestamp,px,py,pz,qw,qx,qy,qz,... (ns)
};

// Goes by the first line that is neither empty nor a comment: 12 or 8 numbers
// and nothing else are poses. Throws Error if the file cannot be read.
PositionFileFormat DetectPositionFormat(const std::string& path);

// Poses rig_from_world by the index of a frame, from those of the reference
// camera. Poses of KITTI are those of the frames in the natural order of their
// names. Those of TUM and EuRoC are interpolated at the times of images; frames
// beyond the trajectory, or in a gap of more than ten median intervals, get
// none. Throws Error for malformed lines, a number of poses that differs from
// that of frames, and images without a time. `format` is not kNamed.
std::vector<std::pair<int, Rigid3>> ReadTrajectoryPoses(
    const Scene& scene, const std::string& path, PositionFileFormat format);

// Their positions by the index of an image: that of the reference sensor (in
// frames without one, any image).
std::vector<std::pair<int, Eigen::Vector3d>> ReadTrajectoryPositions(
    const Scene& scene, const std::string& path, PositionFileFormat format);

}  // namespace mgsfm

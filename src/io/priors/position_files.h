// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <Eigen/Core>
#include <string>
#include <utility>
#include <vector>

#include "mgsfm/geometry/rigid3.h"
#include "mgsfm/scene/scene.h"
#include "rigs/image_times.h"

namespace mgsfm {

// Three numbers of an image, and their line in the file.
struct NamedVector {
  int image_idx = 0;
  Eigen::Vector3d value;
  int line_number = 0;
};

// Reads the lines "image_name A B C" of a file in order; skips empty lines and
// comments ('#'). Names may contain blanks. Throws Error, naming file and line,
// for malformed lines, unknown or repeated images and an unreadable file; its
// message uses `columns` ("X Y Z") and `option` ("ref_images_path").
std::vector<NamedVector> ReadNamedVectors(
    const Scene& scene, const std::string& path, const std::string& columns,
    const std::string& option, UnknownImages others = UnknownImages::kReject);

enum class PositionFileFormat {
  kNamed,  // image_name X Y Z
  kKitti,  // 3x4 poses world_from_cam0, one per frame
  kTum,    // timestamp tx ty tz qx qy qz qw
  kEuroc,  // timestamp,px,py,pz,qw,qx,qy,qz,... (ns)
};

// Detects the format from the first line that is neither empty nor a comment:
// exactly 12 or 8 numbers are poses. Throws Error if the file cannot be read.
PositionFileFormat DetectPositionFormat(const std::string& path);

// Frame poses rig_from_world by frame index, from the poses of the reference
// camera. KITTI poses belong to the frames in the natural order of their names.
// TUM and EuRoC poses are interpolated at image times; frames outside the
// trajectory, or in a gap of more than ten median intervals, get none. Throws
// Error for malformed lines, a number of poses other than the number of frames,
// and images without a time. `format` is not kNamed.
std::vector<std::pair<int, Rigid3>> ReadTrajectoryPoses(
    const Scene& scene, const std::string& path, PositionFileFormat format);

// Positions by image index: of the image of the reference sensor, or of any
// image in frames without one.
std::vector<std::pair<int, Eigen::Vector3d>> ReadTrajectoryPositions(
    const Scene& scene, const std::string& path, PositionFileFormat format);

}  // namespace mgsfm

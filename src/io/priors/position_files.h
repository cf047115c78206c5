// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <Eigen/Core>
#include <optional>
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
  kCsv,    // columns with names, see ReadTimedPositions
};

// Detects the format from the first line that is neither empty nor a comment:
// exactly 12 or 8 numbers, or at least 8 separated by commas, are poses. Other
// files whose names end with .csv are kCsv. Throws Error if the file cannot be
// read.
PositionFileFormat DetectPositionFormat(const std::string& path);

// Frame poses rig_from_world by frame index, from the poses of the reference
// camera. KITTI poses belong to the frames in the natural order of their names.
// Poses with times are interpolated at image times; frames
// outside the trajectory, or in a gap of more than ten median intervals, get
// none. Throws Error for malformed lines, a number of poses other than the
// number of frames, and images without a time. `format` is kKitti,
// kTum or kEuroc. The clock of the file is ahead of that of the images by the
// offset.
std::vector<std::pair<int, Rigid3>> ReadTrajectoryPoses(
    const Scene& scene, const std::string& path, PositionFileFormat format,
    double clock_offset_s = 0.0);

// Three numbers at a time.
struct TimedVector {
  double timestamp_s = 0.0;
  Eigen::Vector3d value;
  std::optional<Eigen::Matrix3d> covariance;
};

// Positions by time from a CSV file whose first line names the columns, in the
// order of their times. `columns` has items KEY=COLUMN separated by commas,
// where COLUMN is a name in the file or its number from 1, and KEY is one of
//   time, time_ms, time_us, time_ns    in s, ms, us, ns; one of them
//   x, y, z                            or latitude, longitude, altitude
//   std_x, std_y, std_z                all or none
// A key without an item names its own column. Throws Error, naming line and
// columns, for missing columns, malformed numbers and repeated times.
std::vector<TimedVector> ReadTimedPositions(const std::string& path,
                                            const std::string& columns);

// Whether the first line has four numbers, the first of which is no image:
// `SECONDS X Y Z`.
bool HasTimedVectors(const Scene& scene, const std::string& path);
std::vector<TimedVector> ReadTimedVectors(const std::string& path);

// The vectors at the times of frames, by image index as above; gaps as for
// poses. Covariances are interpolated like vectors: by convexity, they bound
// those of interpolated vectors whatever the correlation of their errors.
// Throws Error if no frame has one, or an image has no time.
std::vector<std::pair<int, TimedVector>> InterpolateVectors(
    const Scene& scene, const std::string& path,
    const std::vector<TimedVector>& vectors, double clock_offset_s);

// Positions by image index: of the image of the reference sensor, or of any
// image in frames without one.
std::vector<std::pair<int, Eigen::Vector3d>> ReadTrajectoryPositions(
    const Scene& scene, const std::string& path, PositionFileFormat format,
    double clock_offset_s);

}  // namespace mgsfm

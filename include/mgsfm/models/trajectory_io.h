// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <filesystem>
#include <vector>

#include "mgsfm/geometry/rigid3.h"

namespace mgsfm {

// All readers throw Error, naming file and line, for malformed input.

// KITTI odometry: a 3x4 matrix world_from_cam0 in each line. Returns
// cam_from_world.
std::vector<Rigid3> ReadKittiPoses(const std::filesystem::path& path);

// Sorted by time, each time once; the readers throw Error for two different
// poses at one time.
struct TimedPose {
  double timestamp_s = 0.0;
  Rigid3 cam_from_world;
};

// TUM: `timestamp tx ty tz qx qy qz qw`, world_from_cam, in each line; lines
// that begin with '#' are comments.
std::vector<TimedPose> ReadTumPoses(const std::filesystem::path& path);

// EuRoC: `timestamp,px,py,pz,qw,qx,qy,qz`, world_from_cam, in each line, the
// time in ns. Further columns are ignored, as in EuRoC's ground truth, whose
// poses are those of the IMU.
std::vector<TimedPose> ReadEurocPoses(const std::filesystem::path& path);

// KITTI's calib.txt: a 3x4 projection matrix K [I | t] in each line, after an
// optional name such as "P1:". Returns cam_k_from_cam0 in order of the lines;
// lines without exactly 12 numbers are skipped.
std::vector<Rigid3> ReadKittiCalibration(const std::filesystem::path& path);

// EuRoC's sensor.yaml: the matrix T_BS, body_from_sensor. Returns
// sensor_from_body.
Rigid3 ReadEurocCalibration(const std::filesystem::path& path);

}  // namespace mgsfm

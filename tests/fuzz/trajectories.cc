// SPDX-License-Identifier: BSD-3-Clause
#include <cmath>

#include "fuzz/fuzz_target.h"
#include "mgsfm/models/trajectory_io.h"

namespace mgsfm {
namespace {

void CheckPose(const Rigid3& pose) {
  FUZZ_CHECK(pose.translation.allFinite());
  FUZZ_CHECK(std::abs(pose.rotation.norm() - 1.0) < 1e-9);
}

void ReadAs(char kind, const std::filesystem::path& path) {
  switch (kind % 4) {
    case 0:
      for (const Rigid3& pose : ReadKittiPoses(path)) CheckPose(pose);
      return;
    case 1:
      for (const TimedPose& pose : ReadTumPoses(path)) {
        FUZZ_CHECK(std::isfinite(pose.timestamp_s));
        CheckPose(pose.cam_from_world);
      }
      return;
    case 2:
      for (const Rigid3& pose : ReadKittiCalibration(path)) CheckPose(pose);
      return;
    default:
      return CheckPose(ReadEurocCalibration(path));
  }
}

}  // namespace

// The first byte selects the format.
void FuzzTrajectories(const std::string& input) {
  if (input.empty()) return;
  const std::filesystem::path path = FuzzFolder() / "poses.txt";
  WriteTextFile(path, input.substr(1));
  Accepts([&] { ReadAs(input[0], path); });
}

}  // namespace mgsfm

MGSFM_FUZZ_TARGET(trajectories, mgsfm::FuzzTrajectories)

// SPDX-License-Identifier: BSD-3-Clause
#include "simulator/drive.h"

#include <algorithm>
#include <cmath>
#include <string>

#include "geometry/so3.h"
#include "mgsfm/base/error.h"

namespace mgsfm {
namespace {

std::vector<Rigid3> MakePath(const SimulationOptions& options) {
  std::vector<Rigid3> rig_from_world;
  Eigen::Vector3d center = Eigen::Vector3d::Zero();
  const double loop_turn = 2.0 * kPi / options.num_frames;
  for (int i = 0; i < options.num_frames; ++i) {
    const double distance = i * options.frame_spacing_m;
    double yaw = 0.0, pitch = 0.0, roll = 0.0;
    if (options.path == PathPreset::kLoop) {
      yaw = loop_turn * i;
    } else if (options.path == PathPreset::kCurve) {
      yaw = 0.7 * std::sin(distance / 12.0);
      pitch = 0.08 * std::sin(distance / 7.0);
      roll = 0.05 * std::sin(distance / 5.0 + 1.0);
    }
    const Eigen::Quaterniond world_from_rig =
        ExpSO3(Eigen::Vector3d(0.0, yaw, 0.0)) *
        ExpSO3(Eigen::Vector3d(pitch, 0.0, 0.0)) *
        ExpSO3(Eigen::Vector3d(0.0, 0.0, roll));
    rig_from_world.push_back(
        Rigid3::FromRotationAndCenter(world_from_rig.conjugate(), center));
    if (options.path != PathPreset::kStanding) {
      // The step is the chord of the arc between frames, so that loops close
      // exactly.
      const double half_turn =
          options.path == PathPreset::kLoop ? 0.5 * loop_turn : 0.0;
      center +=
          options.frame_spacing_m *
          (world_from_rig * (ExpSO3(Eigen::Vector3d(0.0, half_turn, 0.0)) *
                             Eigen::Vector3d::UnitZ()));
    }
  }
  return rig_from_world;
}

void SetTimes(const SimulationOptions& options,
              const std::vector<double>& timestamps_s, Drive* drive) {
  const size_t num_poses = drive->rig_from_world.size();
  if (timestamps_s.empty()) {
    for (size_t i = 0; i < num_poses; ++i) {
      drive->times_s.push_back(static_cast<double>(i) / options.frame_rate_hz);
    }
    return;
  }
  if (timestamps_s.size() != num_poses) {
    throw Error("the trajectory has " + std::to_string(num_poses) +
                " poses, but " + std::to_string(timestamps_s.size()) +
                " timestamps; provide one timestamp per pose, or none");
  }
  for (size_t i = 1; i < num_poses; ++i) {
    if (!(timestamps_s[i] > timestamps_s[i - 1])) {
      throw Error("the timestamp of pose " + std::to_string(i) +
                  " of the trajectory does not exceed the previous one; sort "
                  "the poses by time");
    }
  }
  drive->times_s = timestamps_s;
}

}  // namespace

Rigid3 Drive::PoseAt(double time_s) const {
  if (rig_from_world.size() < 2) return rig_from_world.front();
  const auto after =
      std::upper_bound(times_s.begin() + 1, times_s.end() - 1, time_s);
  const auto i = static_cast<size_t>(after - times_s.begin());
  const double ratio =
      (time_s - times_s[i - 1]) / (times_s[i] - times_s[i - 1]);
  const Rigid3& pose1 = rig_from_world[i - 1];
  const Rigid3& pose2 = rig_from_world[i];
  const Eigen::Vector3d turn =
      LogSO3(pose2.rotation * pose1.rotation.conjugate());
  const Eigen::Vector3d center =
      pose1.Center() + ratio * (pose2.Center() - pose1.Center());
  return Rigid3::FromRotationAndCenter(
      (ExpSO3(ratio * turn) * pose1.rotation).normalized(), center);
}

Drive MakeDrive(const SimulationOptions& options,
                const SimulationInput& input) {
  Drive drive;
  const bool is_given = !input.rig_from_world_path.empty();
  if (is_given) {
    drive.rig_from_world = input.rig_from_world_path;
  } else {
    MGSFM_CHECK_GT(options.num_frames, 0);
    drive.rig_from_world = MakePath(options);
    drive.is_closed = options.path == PathPreset::kLoop;
  }
  SetTimes(options, input.timestamps_s, &drive);
  const int step = is_given ? options.frame_step : 1;
  MGSFM_CHECK_GT(step, 0);
  for (size_t i = 0; i < drive.rig_from_world.size(); i += step) {
    drive.pose_of_frame.push_back(static_cast<int>(i));
  }
  return drive;
}

Drive SamplePlan(const SimulationOptions& options, const WorldPlan& plan) {
  Drive drive;
  drive.is_level = true;
  drive.num_rigs = static_cast<int>(plan.world_from_rigs.size());
  const double step_s = 1.0 / (options.frame_rate_hz * drive.num_rigs);
  for (const auto& [begin_s, end_s] : plan.sessions_s) {
    const auto num_poses =
        static_cast<int>(std::floor((end_s - begin_s) / step_s + 1e-6));
    for (int i = 0; i < num_poses; ++i) {
      const double time_s = begin_s + i * step_s;
      const int pose = static_cast<int>(drive.times_s.size());
      drive.pose_of_frame.push_back(pose);
      drive.times_s.push_back(time_s);
      drive.rig_from_world.push_back(
          plan.world_from_rigs[pose % drive.num_rigs](time_s).Inverse());
    }
  }
  return drive;
}

}  // namespace mgsfm

// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <cmath>
#include <vector>

#include "geometry/so3.h"
#include "mgsfm/geometry/rigid3.h"
#include "mgsfm/simulator/simulation.h"

namespace mgsfm {

inline constexpr int kSteps = 10;  // poses of the path per frame interval
inline constexpr double kFrameRate = 10.0;

// A winding, smooth path at changing speed, about 10 m/s.
inline std::vector<Rigid3> WindingPath(int num_frames, double speed = 10.0) {
  std::vector<Rigid3> path;
  Eigen::Vector3d center = Eigen::Vector3d::Zero();
  const double step_s = 1.0 / (kSteps * kFrameRate);
  for (int i = 0; i <= (num_frames - 1) * kSteps; ++i) {
    const double time_s = i * step_s;
    const Eigen::Quaterniond world_from_rig =
        ExpSO3(Eigen::Vector3d(0.0, 0.7 * std::sin(0.9 * time_s), 0.0)) *
        ExpSO3(Eigen::Vector3d(0.05 * std::sin(1.7 * time_s), 0.0, 0.0));
    path.push_back(
        Rigid3::FromRotationAndCenter(world_from_rig.conjugate(), center));
    center += step_s * speed * (1.0 + 0.3 * std::sin(1.3 * time_s)) *
              (world_from_rig * Eigen::Vector3d::UnitZ());
  }
  return path;
}

inline SimulationOptions DriveOptions(RigPreset rig) {
  SimulationOptions options;
  options.rig = rig;
  options.frame_step = kSteps;
  options.frame_rate_hz = kSteps * kFrameRate;
  options.num_points_per_frame = 120;
  options.max_num_features_per_image = 250;
  options.pixel_noise_px = 0.4;
  return options;
}

}  // namespace mgsfm

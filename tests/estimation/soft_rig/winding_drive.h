// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <cmath>
#include <vector>

#include "estimation/bundle_adjustment/bundle_fixtures.h"
#include "geometry/so3.h"
#include "mgsfm/geometry/rigid3.h"
#include "mgsfm/simulator/simulation.h"
#include "soft_rig/rig_trajectory.h"

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

// The times of images and their frames, on one clock.
inline CaptureTimes TimesOf(const Scene& scene) {
  CaptureTimes times{{}, {}, true};
  for (size_t f = 0; f < scene.frames.size(); ++f) {
    times.frames.push_back(TimeOfFrame(scene, static_cast<int>(f)));
  }
  for (const Image& image : scene.images) {
    times.images.push_back(*image.timestamp_s);
  }
  return times;
}

inline Reconstruction AdjustRigid(const Simulation& drive) {
  return RefineReconstruction(
             drive.scene, FixedCandidates(GroupTracks(drive.ground_truth)),
             Perturbed(drive.scene, drive.ground_truth, 0.01, 3),
             BundleAdjustmentOptions(), Threads(2))
      .estimate;
}

inline double PathLength(const Reconstruction& model) {
  double length = 0.0;
  for (size_t f = 1; f < model.rig_from_world.size(); ++f) {
    length += (model.rig_from_world[f]->Center() -
               model.rig_from_world[f - 1]->Center())
                  .norm();
  }
  return length;
}

}  // namespace mgsfm

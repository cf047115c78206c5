// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <optional>
#include <vector>

#include "mgsfm/geometry/rigid3.h"
#include "mgsfm/scene/estimates.h"
#include "mgsfm/scene/scene.h"
#include "soft_rig/rig_trajectory.h"

namespace mgsfm {

// The motion of a rig between the time of a frame and that of one of its
// images.
class ImageMotions {
 public:
  // Without use_times, all images are taken at the time of their frame.
  ImageMotions(const Scene& scene, bool use_times);

  // Sets the trajectories of all rigs from the poses of their frames.
  void SetTrajectories(const Reconstruction& reconstruction);

  // D_i of soft_rig.h for a registered image whose camera triggers late by
  // offset_s.
  Rigid3 MotionOf(int image_idx, double offset_s) const;
  // Time between the two frames around the image; infinite if there is only
  // one frame.
  double IntervalAt(int image_idx, double offset_s) const;
  // Median time between two frames of a rig; infinite if there is only one.
  double MedianInterval(int rig_idx) const;

 private:
  const RigTrajectory& TrajectoryOf(int image_idx) const;

  const Scene& scene_;
  const bool use_times_;
  // Per rig; nullopt if none of its frames is registered.
  std::vector<std::optional<RigTrajectory>> trajectories_;
  std::vector<double> median_interval_;  // per rig
  std::vector<Rigid3> world_from_rig_;   // per frame
};

}  // namespace mgsfm

// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <vector>

#include "mgsfm/geometry/rigid3.h"
#include "mgsfm/simulator/simulation.h"
#include "simulator/worlds/world_plan.h"

namespace mgsfm {

// The motion of the rig: poses at increasing times, some of which are frames.
struct Drive {
  std::vector<Rigid3> rig_from_world;
  std::vector<double> times_s;
  std::vector<int> pose_of_frame;
  bool is_closed = false;  // the first frame follows the last one
  bool is_level = false;   // the z axis of the world points up
  int num_rigs = 1;        // they take frames in turns

  // Interpolates, and extrapolates beyond the ends, with constant velocity.
  Rigid3 PoseAt(double time_s) const;
  int num_frames() const { return static_cast<int>(pose_of_frame.size()); }
  const Rigid3& PoseOfFrame(int frame) const {
    return rig_from_world[pose_of_frame[frame]];
  }
  double TimeOfFrame(int frame) const { return times_s[pose_of_frame[frame]]; }
};

// The drive along the trajectory of `input`, or of `options` if it has none.
// Throws Error for times that do not increase or do not match the poses.
Drive MakeDrive(const SimulationOptions& options, const SimulationInput& input);

// The paths of a plan at `options.frame_rate_hz`; several rigs alternate.
Drive SamplePlan(const SimulationOptions& options, const WorldPlan& plan);

}  // namespace mgsfm

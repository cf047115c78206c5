// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <Eigen/Core>
#include <vector>

#include "mgsfm/geometry/rigid3.h"
#include "rig_solver/rig_problem.h"

namespace mgsfm {

// The continuous trajectory of a rig: cubic Hermite interpolation of centers
// and of rotations, the latter by their logarithm relative to the previous
// frame. Velocities at frames come from the parabola through the frame and its
// two neighbors. The velocity is therefore continuous, and the error is of
// third order in the time between frames. Extrapolation has constant velocity.
class RigTrajectory {
 public:
  // Needs at least one pose and increasing times.
  RigTrajectory(std::vector<double> times_s,
                std::vector<Rigid3> rig_from_world);

  Rigid3 PoseAt(double time_s) const;
  // The angular velocity in the rig at a frame, and the velocity of its center
  // in the world.
  PoseVector VelocityAt(size_t frame) const;
  // Time between the two frames around time_s; infinite if there is only one
  // frame.
  double IntervalAt(double time_s) const;

 private:
  size_t SegmentAt(double time_s) const;
  void SetVelocities();
  Rigid3 Extrapolate(size_t frame, double time_s) const;

  std::vector<double> times_s_;
  std::vector<Rigid3> poses_;
  // Per frame; angular velocities in the rig, velocities in the world.
  std::vector<Eigen::Vector3d> angular_velocities_, velocities_;
};

}  // namespace mgsfm

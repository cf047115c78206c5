// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <Eigen/Core>
#include <vector>

#include "mgsfm/geometry/rigid3.h"

namespace mgsfm {

// The path of a rig between its frames: cubic Hermite interpolation of centres,
// and of rotations by their logarithm relative to the frame before. Velocities
// at frames are those of the parabola through them and their neighbours, so
// that the error is of third order in the time between frames, and velocity is
// continuous. Beyond the ends: constant velocity.
class RigPath {
 public:
  // At least one pose; times must increase.
  RigPath(std::vector<double> times_s, std::vector<Rigid3> rig_from_world);

  Rigid3 PoseAt(double time_s) const;
  // Between the frames around the time; infinite if there is one frame only.
  double IntervalAt(double time_s) const;

 private:
  size_t SegmentAt(double time_s) const;
  void SetVelocities();
  Rigid3 Extrapolate(size_t frame, double time_s) const;

  std::vector<double> times_s_;
  std::vector<Rigid3> poses_;
  // Per frame; turns about axes of the rig.
  std::vector<Eigen::Vector3d> turn_rates_, velocities_;
};

}  // namespace mgsfm

// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <Eigen/Core>
#include <optional>
#include <vector>

#include "mgsfm/geometry/rigid3.h"
#include "mgsfm/scene/estimates.h"
#include "mgsfm/scene/scene.h"
#include "rig_solver/rig_problem.h"

namespace mgsfm {

// The continuous trajectory of a rig: cubic Hermite interpolation of centers
// and rotations (logarithms relative to the previous frame). Velocities at
// frames come from the parabola through the frame and its two neighbors. The
// velocity is therefore continuous, and the error is of third order in the time
// between frames. Extrapolation has constant velocity.
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

// The motion of a rig between the time of a frame and the time of one of its
// images.
class ImageMotions {
 public:
  // Without use_times, all images are taken at the time of their frame.
  ImageMotions(const Scene& scene, bool use_times);

  // Sets the trajectories of all rigs from the poses of their frames.
  void SetTrajectories(const Reconstruction& reconstruction);

  // D_i of soft_rig.h for a registered image whose camera triggers offset_s
  // late.
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

// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <Eigen/Core>
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
  // The angular velocity in the rig, and the velocity of its center in the
  // world.
  PoseVector VelocityAt(double time_s) const;
  // Infinite if there is only one frame.
  double MedianInterval() const;

 private:
  size_t SegmentAt(double time_s) const;
  void SetVelocities();
  Rigid3 Extrapolate(size_t frame, double time_s) const;

  std::vector<double> times_s_;
  std::vector<Rigid3> poses_;
  // Per frame; angular velocities in the rig, velocities in the world.
  std::vector<Eigen::Vector3d> angular_velocities_, velocities_;
};

// When frames and images are taken: in seconds on one clock or, without times,
// the number of the frame in its rig.
struct CaptureTimes {
  std::vector<double> frames;
  std::vector<double> images;
  bool are_seconds = false;
};

// Per rig, the times and indices of its frames with a pose, sorted.
std::vector<std::vector<std::pair<double, int>>> FramesOfRigs(
    const Scene& scene, const CaptureTimes& times, const Reconstruction& model);

// The motions of rigs at the times of their images.
struct ImageMotions {
  std::vector<RigMotion> since_frame;  // per image
  // Per image and unit of time: the angular velocity in the rig, the velocity
  // of its center in the world.
  std::vector<PoseVector> rates;
  // Per rig, the median time between two frames; infinite if there is only one.
  std::vector<double> median_intervals;
};

// `delays` are per sensor: how long after its time an image is taken.
ImageMotions FindImageMotions(const Scene& scene, const CaptureTimes& times,
                              const std::vector<double>& delays,
                              const Reconstruction& model);

}  // namespace mgsfm

// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <cstddef>
#include <functional>
#include <optional>
#include <vector>

#include "mgsfm/geometry/rigid3.h"
#include "moving_objects/motion_continuity.h"

namespace mgsfm {

// The motions among which the search (motion_search.h) chooses.
//
// Correspondences with depth measure the distance of a step, but turn it by up
// to a degree where they are few. Image pairs of one camera measure the
// rotation and direction well, but no distance. Pairs that agree form one
// group, whose motion is their mean, weighted by matches. A motion with depth
// that a group agrees with has the rotation and direction of the group for the
// comparison of velocities, and its own distance.

// Per step, or per unit of time, with covariances.
struct Velocity {
  Eigen::Vector3d linear = Eigen::Vector3d::Zero();  // of the rig's origin
  Eigen::Vector3d angular_rad = Eigen::Vector3d::Zero();
  Eigen::Matrix3d linear_covariance = Eigen::Matrix3d::Zero();
  Eigen::Matrix3d angular_covariance = Eigen::Matrix3d::Zero();
};
Velocity VelocityOf(const MeasuredMotion& motion, double duration);
MeasuredMotion MotionOf(const Velocity& velocity, double duration);

// Whether two motions are equal, up to `factor` times the tolerance, which
// includes the variances of both along their difference.
bool AreEqualMotions(const MeasuredMotion& a, const MeasuredMotion& b,
                     const MotionNoise& noise, double factor = 1.0);

// Standard deviations, per axis, of the change of a velocity within one step.
struct VelocityChange {
  double linear = 0.0;
  double angular_rad = 0.0;
};
VelocityChange TypicalChange(const Velocity& a, const Velocity& b,
                             const MotionNoise& noise);

// The squared difference of two velocities, in standard deviations of changes
// within one step and of their measurements.
double SquaredChange(const Velocity& a, const Velocity& b,
                     const MotionNoise& noise);

// A hypothesis. If its distance is free, one of those that are tried, and the
// motions by matches with depth that agree with it.
struct Candidate : MotionHypothesis {
  std::vector<MeasuredMotion> measured = {};
  std::optional<Eigen::Vector3d> tried_center = {};
  // The logarithm of the largest reach of another motion over its own; at least
  // zero.
  double nearness = 0.0;
  // Before `later_from_earlier` took the rotation and direction of a group.
  std::optional<MeasuredMotion> by_depth = {};

  // The motion after one with this center.
  MeasuredMotion MotionAfter(const Eigen::Vector3d& center) const {
    return ClosestTo(tried_center.value_or(center));
  }
};

// The steps of one sequence, and how long each takes.
struct Steps {
  std::vector<std::vector<Candidate>> candidates;
  std::vector<double> durations;
  MotionNoise noise;
  double longest_step = 0.0;  // of those that are tried
  // Compares two motions of step k (motion_continuity.h); may be empty.
  std::function<MotionExclusion(size_t, const Rigid3&, const Rigid3&)> compare =
      {};

  size_t size() const { return candidates.size(); }

  // The velocity of a candidate after a step with another one.
  Velocity VelocityAfter(const Eigen::Vector3d& linear, size_t k,
                         const Candidate& candidate) const {
    return VelocityOf(candidate.MotionAfter(durations[k] * linear),
                      durations[k]);
  }
};

// The center of a step of some length in the direction of a hypothesis.
Eigen::Vector3d ForwardStep(const MotionHypothesis& hypothesis, double length);

// The variance of a covariance along a vector.
double VarianceAlong(const Eigen::Matrix3d& covariance,
                     const Eigen::Vector3d& vector);

// Groups the hypotheses of each step.
Steps MakeSteps(const std::vector<StepHypotheses>& measured,
                std::vector<double> durations);

// Whether a motion other than that with the largest share has support, and goes
// on in a neighboring step.
bool HasRivals(const Steps& steps, size_t k);

// The candidates of a step, those without a distance once for each distance to
// try.
std::vector<Candidate> TryDistances(const Steps& steps, size_t k);

// Distances that are tried are this many standard deviations of the change of
// velocity apart. The cost of the nearest one is too high by at most 0.16.
inline constexpr double kDistanceSpacing = 0.8;
// Hypotheses agree within this share of the longer step, plus a share of the
// median step, and within an angle.
inline constexpr double kRelativeTolerance = 0.2;

}  // namespace mgsfm

// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <cstddef>
#include <functional>
#include <optional>
#include <vector>

#include "geometry/so3.h"
#include "mgsfm/geometry/rigid3.h"
#include "moving_objects/measured_motion.h"

namespace mgsfm {

// The motions among which the search (motion_search.h) chooses.
//
// Correspondences with depth measure the distance of a step, but turn it by up
// to a degree where they are few. Image pairs of one camera measure the
// rotation and direction well, but no distance. Pairs that agree form one
// group, whose motion is their mean, weighted by matches. A motion with depth
// that a group agrees with has the rotation and direction of the group for the
// comparison of velocities, and its own distance.

// A motion of a step, between rig frames, by the noise of keypoints and depths.
// The covariance of the center is that of `free_direction`, if there is one.
struct MotionHypothesis : MeasuredMotion {
  // Fractions of the matches of the step that agree, and that agree with no
  // earlier hypothesis.
  double share = 1.0;
  double own_share = 1.0;
  // A single camera does not measure how far it moved: any non-negative
  // multiple of this vector, in the earlier rig frame, may be added to the
  // center of `later_from_earlier`. Zero without parallax.
  std::optional<Eigen::Vector3d> free_direction = {};
  // Distance and spread of the points that agree with this hypothesis only:
  // the geometric mean of their median distances from the rig and from their
  // coordinate-wise median. nullopt if there is no other motion, or if there
  // are too few points or all coincide.
  std::optional<double> reach = {};

  // The motion, over all multiples, whose center is closest to `center`.
  [[nodiscard]] MeasuredMotion ClosestTo(const Eigen::Vector3d& center) const;
};
using StepHypotheses = std::vector<MotionHypothesis>;

// The errors and changes of motion that all steps of one recording share. With
// a wrong focal length, an inaccurate rig or unsynchronized cameras, depths and
// image pairs, or pairs of different cameras, disagree about every step; a
// disagreement is then no evidence for an object. Low quantiles over all steps
// are robust to objects in most of them. They exclude the covariances of the
// hypotheses.
struct MotionNoise {
  double median_step = 0.0;
  // Standard deviations, per axis, of the difference of two measurements of one
  // step: of the rotation, and of the center relative to its length.
  double rotation_rad = 0.0;
  double relative_center = 0.0;
  // Depths are no evidence of motions: motions by depth differ in rotation from
  // those of image pairs by more than the tolerance of agreement, and by more
  // than image pairs of different cameras differ. With a wrong lens, a rolling
  // shutter or late exposures, the rays of a match within a frame enclose an
  // angle that is no parallax.
  bool depths_contradict_pairs = false;
  // Standard deviations of the change of velocity from one step to the next.
  double turn_change_rad = 0.0;
  double linear_change = 0.0;
};

// The evidence in the matches of two frames that two motions do not belong to
// one rigid scene. An inaccurate motion, due to small parallax or a wrong
// calibration, still agrees with the matches of the true motion; the motion of
// an object does not.
struct MotionExclusion {
  // Each motion has a fraction of the matches of both motions that agrees with
  // it alone; this is the smaller one.
  double share = 0.0;
  // The fraction of the matches of the first motion that contradict the second.
  double unexplained = 0.0;
  // The number of matches that agree with the second motion only, less the
  // number that agree with the first one only.
  std::ptrdiff_t balance = 0;
};
// Motions exclude each other from this value on. A competing motion must also
// explain as many matches, and other matches than the motions before it.
inline constexpr double kContestingShare = 0.15;

// The evidence about the motion between two frames of a sequence. Several
// threads may call these functions at once.
struct MotionEvidence {
  std::function<StepHypotheses(int earlier_frame_idx, int later_frame_idx)>
      find;
  // Without it, motions that differ exclude each other.
  std::function<MotionExclusion(int earlier_frame_idx, int later_frame_idx,
                                const Rigid3& motion1, const Rigid3& motion2)>
      compare = {};
  // The motion near `motion` that the matches determine; nullopt if too few
  // agree. Without it, competing motions recur only as hypotheses.
  std::function<std::optional<MeasuredMotion>(
      int earlier_frame_idx, int later_frame_idx, const Rigid3& motion)>
      refine = {};
};

// Whether the errors of a measurement are within the tolerance of motions that
// agree.
bool IsCertain(const MeasuredMotion& motion, const MotionNoise& noise);

// Whether two motions are equal, up to `factor` times the tolerance, which
// includes both variances along their difference.
bool AreEqualMotions(const MeasuredMotion& a, const MeasuredMotion& b,
                     const MotionNoise& noise, double factor = 1.0);

// Standard deviations, per axis, of the change of a velocity within one step.
struct VelocityChange {
  double linear = 0.0;
  double angular_rad = 0.0;
};
VelocityChange TypicalChange(const Velocity& a, const Velocity& b,
                             const MotionNoise& noise);

// The squared difference of two velocities, normalized by the changes within
// one step and by their measurement noise.
double SquaredChange(const Velocity& a, const Velocity& b,
                     const MotionNoise& noise);

// A hypothesis, with one of the distances to try if its distance is free, and
// the motions from matches with depth that agree with it.
struct Candidate : MotionHypothesis {
  // The number of steps that it spans. It is a candidate of the last one.
  size_t num_steps = 1;
  std::vector<MeasuredMotion> measured = {};
  std::optional<Eigen::Vector3d> tried_center = {};
  // The logarithm of the largest depth extent of another motion relative to its
  // own; at least zero.
  double nearness = 0.0;
  // The motion by depth, before `later_from_earlier` took the rotation and
  // direction of a group.
  std::optional<MeasuredMotion> by_depth = {};

  // The motion that follows a motion with this center.
  MeasuredMotion MotionAfter(const Eigen::Vector3d& center) const {
    return ClosestTo(tried_center.value_or(center));
  }
};

// The hypotheses of a step with a distance, and the groups of those without
// one that have parallax.
std::vector<Candidate> GroupHypotheses(const StepHypotheses& step,
                                       const MotionNoise& noise);

// The steps of one sequence, and how long each takes.
struct Steps {
  std::vector<std::vector<Candidate>> candidates;
  std::vector<double> durations;
  MotionNoise noise;
  double longest_step = 0.0;  // of those that are tried
  // The functions of MotionEvidence for step k.
  std::function<MotionExclusion(size_t, const Rigid3&, const Rigid3&)> compare =
      {};
  std::function<std::optional<MeasuredMotion>(size_t, const Rigid3&)> refine =
      {};

  size_t size() const { return candidates.size(); }
  // False for a step beside the sequence, too.
  bool HasCandidates(size_t k) const {
    return k < candidates.size() && !candidates[k].empty();
  }

  // The duration of the `num_steps` steps up to step k.
  double Duration(size_t k, size_t num_steps) const;
  // The velocity of a candidate after a step with another one.
  Velocity VelocityAfter(const Eigen::Vector3d& linear, size_t k,
                         const Candidate& candidate) const {
    const double duration = Duration(k, candidate.num_steps);
    return VelocityOf(candidate.MotionAfter(duration * linear), duration);
  }
  // The motion of a candidate. A free one takes a step of the median length.
  MeasuredMotion MotionOf(size_t k, const Candidate& candidate) const;
};

// The center after a step of some length in the direction of a hypothesis.
Eigen::Vector3d ForwardStep(const MotionHypothesis& hypothesis, double length);

// Groups the hypotheses of each step.
Steps MakeSteps(const std::vector<StepHypotheses>& measured,
                std::vector<double> durations);

// The candidates of a step, with one candidate for each distance to try if the
// distance is free.
std::vector<Candidate> TryDistances(const Steps& steps, size_t k);

// Motions, and pairs with them, agree within this fraction of the longer step,
// plus a fraction of the median step, and this angle: the error of pairs with
// the minimum number of matches.
inline constexpr double kRelativeTolerance = 0.2;
inline constexpr double kMaxAngle_rad = DegToRad(1.0);

}  // namespace mgsfm

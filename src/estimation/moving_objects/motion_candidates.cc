// SPDX-License-Identifier: BSD-3-Clause
#include "moving_objects/motion_candidates.h"

#include <algorithm>
#include <cmath>
#include <utility>

#include "base/ranges.h"
#include "geometry/so3.h"
#include "math/statistics.h"

namespace mgsfm {

using Eigen::Matrix3d;
using Eigen::Vector3d;

namespace {

// The thresholds of this file at half and twice their values are compared in
// docs/results/constants.md.
//
// The change of speed per step, relative to the larger speed: a car that brakes
// hard from 14 m/s loses 0.1 of its speed in 0.3 s.
constexpr double kRelativeChange = 0.1;
// An additional change of speed per step, relative to the median speed, so that
// a rig can stop at walking pace.
constexpr double kMinChange = 0.03;
// The longest distance to try is twice this quantile of the measured distances:
// most may belong to objects at a constant distance, a few to mismatches.
constexpr double kLongQuantile = 0.9;
// Spacing of the distances to try, in standard deviations of the change of
// velocity. The cost of the nearest one is too high by at most 0.16.
constexpr double kDistanceSpacing = 0.8;
// Bounds the cost where most measured distances are zero.
constexpr double kMaxNumDistances = 200.0;
// The fraction of the median step within which motions agree. Turns may change
// by kMaxAngle_rad per step, in addition to the typical change in the
// recording, so that errors do not count as changes.
constexpr double kMinTolerance = 0.04;
// 99 % of the differences of two measurements of one vector of three normal
// components are shorter than this, in standard deviations of a component.
constexpr double kNumSigmas = 3.37;
// The lower quartile and the median of the lengths of such vectors. The
// quartile tolerates objects in up to three quarters of the steps.
constexpr double kQuartileOfNorm = 1.10;
constexpr double kMedianOfNorm = 1.54;

// The standard deviation of a component of vectors, by their lengths.
double SigmaOfNorms(std::vector<double> norms) {
  return norms.empty() ? 0.0
                       : Quantile(std::move(norms), 0.25) / kQuartileOfNorm;
}

// The hypotheses of a step with a distance, or those without, by descending
// share.
StepHypotheses SortedByShare(const StepHypotheses& step, bool has_distance) {
  StepHypotheses sorted;
  for (const MotionHypothesis& h : step) {
    if (h.free_direction.has_value() != has_distance) sorted.push_back(h);
  }
  StableSortDescendingBy(&sorted, [](const auto& a) { return a.share; });
  return sorted;
}

// The length of a difference beyond the noise of its measurement.
double Excess(const Vector3d& difference, const Matrix3d& covariance) {
  return std::sqrt(
      std::max(0.0, difference.squaredNorm() - covariance.trace()));
}

// The difference of two measurements of one motion, with its covariances.
struct MotionDifference {
  Vector3d rotation_rad, center;
  Matrix3d rotation_covariance, center_covariance;
};

MotionDifference DifferenceOf(const MeasuredMotion& a,
                              const MeasuredMotion& b) {
  return {LogSO3(a.later_from_earlier.rotation *
                 b.later_from_earlier.rotation.conjugate()),
          a.later_from_earlier.Center() - b.later_from_earlier.Center(),
          a.rotation_covariance + b.rotation_covariance,
          a.center_covariance + b.center_covariance};
}

// Differences of two measurements of each step, beyond their own noise.
struct Disagreement {
  std::vector<double> angles_rad, relative_errors;

  void Add(const MotionHypothesis& free, const MeasuredMotion& motion,
           double min_length) {
    const Vector3d center = motion.later_from_earlier.Center();
    const MotionDifference difference =
        DifferenceOf(free.ClosestTo(center), motion);
    angles_rad.push_back(
        Excess(difference.rotation_rad, difference.rotation_covariance));
    if (center.norm() < min_length) return;
    relative_errors.push_back(
        Excess(difference.center, difference.center_covariance) /
        center.norm());
  }
};

// The hypothesis with the rotation closest to that of another.
const MotionHypothesis& ClosestRotation(const StepHypotheses& step,
                                        const MotionHypothesis& other) {
  const auto angle = [&](const MotionHypothesis& h) {
    return AngleBetween(h.later_from_earlier.rotation,
                        other.later_from_earlier.rotation);
  };
  return *std::min_element(
      step.begin(), step.end(),
      [&](const auto& a, const auto& b) { return angle(a) < angle(b); });
}

// How much hypotheses of one motion from different sources differ: the
// strongest image pair compared with the closest motion by depth and with the
// next image pair, whichever difference is larger.
void MeasureDisagreement(const std::vector<StepHypotheses>& measured,
                         MotionNoise* noise) {
  Disagreement of_depths, of_pairs;
  const double min_length = kMinTolerance * noise->median_step;
  for (const StepHypotheses& step : measured) {
    const StepHypotheses by_depth = SortedByShare(step, true);
    const StepHypotheses free = SortedByShare(step, false);
    if (!by_depth.empty() && !free.empty()) {
      of_depths.Add(free[0], ClosestRotation(by_depth, free[0]), min_length);
    }
    if (free.size() > 1) {
      of_pairs.Add(free[1],
                   free[0].ClosestTo(ForwardStep(free[0], noise->median_step)),
                   min_length);
    }
  }
  const double turn_of_depths_rad =
      SigmaOfNorms(std::move(of_depths.angles_rad));
  const double turn_of_pairs_rad = SigmaOfNorms(std::move(of_pairs.angles_rad));
  noise->rotation_rad = std::max(turn_of_depths_rad, turn_of_pairs_rad);
  noise->depths_contradict_pairs =
      turn_of_depths_rad > turn_of_pairs_rad &&
      kNumSigmas * turn_of_depths_rad > kMaxAngle_rad;
  noise->relative_center =
      std::max(SigmaOfNorms(std::move(of_depths.relative_errors)),
               SigmaOfNorms(std::move(of_pairs.relative_errors)));
}

// How much the strongest motions of consecutive steps differ.
void MeasureChanges(const std::vector<StepHypotheses>& measured,
                    const std::vector<double>& durations, MotionNoise* noise) {
  std::vector<double> linear, angular_rad;
  std::optional<Velocity> before;
  for (size_t k = 0; k < measured.size(); ++k) {
    const StepHypotheses by_depth = SortedByShare(measured[k], true);
    if (by_depth.empty()) {
      before.reset();
      continue;
    }
    const Velocity velocity = VelocityOf(by_depth[0], durations[k]);
    if (before) {
      linear.push_back(
          Excess(velocity.linear - before->linear,
                 velocity.linear_covariance + before->linear_covariance));
      angular_rad.push_back(
          Excess(velocity.angular_rad - before->angular_rad,
                 velocity.angular_covariance + before->angular_covariance));
    }
    before = velocity;
  }
  if (linear.empty()) return;
  noise->linear_change = Median(std::move(linear)) / kMedianOfNorm;
  noise->turn_change_rad = Median(std::move(angular_rad)) / kMedianOfNorm;
}

// A pair without parallax.
bool IsStill(const MotionHypothesis& hypothesis) {
  return hypothesis.free_direction && hypothesis.free_direction->isZero(0.0);
}

// Whether a free hypothesis agrees with one with a distance. If it has
// parallax, it supports only distances that differ from zero significantly.
bool SupportsDistance(const MotionHypothesis& free,
                      const MeasuredMotion& motion, const MotionNoise& noise) {
  const Vector3d center = motion.later_from_earlier.Center();
  MotionNoise of_kind = noise;
  if (!IsStill(free)) {
    of_kind.median_step = 0.0;
    if (center.squaredNorm() <=
        kNumSigmas * kNumSigmas *
            VarianceAlong(motion.center_covariance, center)) {
      return false;
    }
  }
  return AreEqualMotions(free.ClosestTo(center), motion, of_kind);
}

// Adds a hypothesis to a group with which it agrees.
void Join(const MotionHypothesis& h, Candidate* group) {
  const double weight = h.share / (group->share + h.share);
  const auto covariance_of_mean = [&](const Matrix3d& a, const Matrix3d& b) {
    return Matrix3d((1.0 - weight) * (1.0 - weight) * a + weight * weight * b);
  };
  group->rotation_covariance =
      covariance_of_mean(group->rotation_covariance, h.rotation_covariance);
  const auto mean = [&](const Vector3d& a, const Vector3d& b) -> Vector3d {
    return (1.0 - weight) * a + weight * b;
  };
  const Rigid3& motion = group->later_from_earlier;
  const Eigen::Quaterniond difference =
      h.later_from_earlier.rotation * motion.rotation.conjugate();
  group->later_from_earlier = Rigid3::FromRotationAndCenter(
      (ExpSO3(weight * LogSO3(difference)) * motion.rotation).normalized(),
      mean(motion.Center(), h.later_from_earlier.Center()));
  if (!IsStill(*group) && !IsStill(h)) {
    group->free_direction =
        mean(*group->free_direction, *h.free_direction).normalized();
    group->center_covariance =
        covariance_of_mean(group->center_covariance, h.center_covariance);
  }
  group->share += h.share;
  group->own_share += h.share;
}

// Compares the point distances of all motions by depth.
void MeasureNearness(const MotionNoise& noise,
                     std::vector<Candidate>* by_depth) {
  for (Candidate& candidate : *by_depth) {
    for (const Candidate& rival : *by_depth) {
      if (!candidate.reach || !rival.reach ||
          rival.own_share < kContestingShare ||
          AreEqualMotions(candidate, rival, noise)) {
        continue;
      }
      candidate.nearness = std::max(candidate.nearness,
                                    std::log(*rival.reach / *candidate.reach));
    }
  }
}

// The free hypotheses, in groups that agree.
std::vector<Candidate> GroupFree(const StepHypotheses& step,
                                 const MotionNoise& noise) {
  const auto agree = [&](const MotionHypothesis& a, const MotionHypothesis& b) {
    const MeasuredMotion motion =
        a.ClosestTo(ForwardStep(a, noise.median_step));
    return AreEqualMotions(b.ClosestTo(motion.later_from_earlier.Center()),
                           motion, noise);
  };
  std::vector<Candidate> groups;
  for (const MotionHypothesis& h : SortedByShare(step, false)) {
    const auto group = std::find_if(groups.begin(), groups.end(),
                                    [&](const auto& g) { return agree(g, h); });
    if (group == groups.end()) {
      groups.push_back({h});
    } else {
      Join(h, &*group);
    }
  }
  return groups;
}

// Compares a motion by depth with the groups. Both kinds of evidence have equal
// weight. A group has no matches with depth; the motion that agrees with it
// provides its distance and how near its points are.
void Combine(const MotionNoise& noise, Candidate* by_depth,
             std::vector<Candidate>* groups) {
  const MeasuredMotion motion = *by_depth;
  double support = 0.0;
  const Candidate* strongest = nullptr;
  for (Candidate& group : *groups) {
    if (!SupportsDistance(group, motion, noise)) continue;
    support += group.share;
    group.nearness = group.measured.empty()
                         ? by_depth->nearness
                         : std::min(group.nearness, by_depth->nearness);
    group.measured.push_back(motion);
    if (IsStill(group)) continue;
    if (strongest == nullptr || group.share > strongest->share) {
      strongest = &group;
    }
  }
  by_depth->share = 0.5 * (by_depth->share + std::min(support, 1.0));
  if (strongest == nullptr) return;
  by_depth->by_depth = motion;
  static_cast<MeasuredMotion&>(*by_depth) =
      strongest->ClosestTo(motion.later_from_earlier.Center());
  // The variance of the distance comes from the depths.
  const Vector3d& direction = *strongest->free_direction;
  by_depth->center_covariance +=
      direction * VarianceAlong(motion.center_covariance, direction) *
      direction.transpose();
}

// The distances to try for a step of this duration.
std::vector<double> DistancesToTry(const Steps& steps, double duration) {
  std::vector<double> distances{0.0};
  const double longest = duration * steps.longest_step;
  while (distances.back() < longest) {
    const double change = kRelativeChange * distances.back() +
                          kMinChange * duration * steps.noise.median_step;
    distances.push_back(
        distances.back() +
        std::max(kDistanceSpacing * change, longest / kMaxNumDistances));
  }
  return distances;
}

// The tolerances of centers at this distance and of rotations that agree,
// without the errors of their measurement.
double CenterTolerance(double distance, const MotionNoise& noise) {
  return std::max(kRelativeTolerance, kNumSigmas * noise.relative_center) *
             distance +
         kMinTolerance * noise.median_step;
}
double AngleToleranceRad(const MotionNoise& noise) {
  return std::max(kMaxAngle_rad, kNumSigmas * noise.rotation_rad);
}

}  // namespace

std::vector<Candidate> GroupHypotheses(const StepHypotheses& step,
                                       const MotionNoise& noise) {
  std::vector<Candidate> candidates;
  for (const MotionHypothesis& h : step) {
    if (!h.free_direction) candidates.push_back({h});
  }
  MeasureNearness(noise, &candidates);
  std::vector<Candidate> groups = GroupFree(step, noise);
  if (groups.empty()) return candidates;
  for (Candidate& candidate : candidates) {
    Combine(noise, &candidate, &groups);
  }
  for (Candidate& group : groups) {
    group.share *= 0.5;
    if (!IsStill(group)) candidates.push_back(std::move(group));
  }
  return candidates;
}

MeasuredMotion MotionHypothesis::ClosestTo(const Vector3d& center) const {
  MeasuredMotion motion = *this;
  if (!free_direction || free_direction->isZero(0.0)) return motion;
  const Vector3d nearest = later_from_earlier.Center();
  const double distance = std::max(0.0, free_direction->dot(center - nearest));
  motion.later_from_earlier = Rigid3::FromRotationAndCenter(
      later_from_earlier.rotation, nearest + distance * *free_direction);
  motion.center_covariance *= distance * distance;
  return motion;
}

MeasuredMotion Steps::MotionOf(size_t k, const Candidate& candidate) const {
  return candidate.MotionAfter(ForwardStep(
      candidate, Duration(k, candidate.num_steps) * noise.median_step));
}

double Steps::Duration(size_t k, size_t num_steps) const {
  double duration = 0.0;
  for (size_t i = 0; i < num_steps; ++i) duration += durations[k - i];
  return duration;
}

bool IsCertain(const MeasuredMotion& motion, const MotionNoise& noise) {
  const auto is_within = [](const Matrix3d& covariance, double bound) {
    return kNumSigmas * kNumSigmas * covariance.trace() <= 3.0 * bound * bound;
  };
  return is_within(motion.center_covariance,
                   CenterTolerance(motion.later_from_earlier.Center().norm(),
                                   noise)) &&
         is_within(motion.rotation_covariance, AngleToleranceRad(noise));
}

bool AreEqualMotions(const MeasuredMotion& a, const MeasuredMotion& b,
                     const MotionNoise& noise, double factor) {
  const MotionDifference difference = DifferenceOf(a, b);
  const double tolerance =
      CenterTolerance(std::max(a.later_from_earlier.Center().norm(),
                               b.later_from_earlier.Center().norm()),
                      noise);
  const double tolerance_rad = AngleToleranceRad(noise);
  const auto is_within = [factor](const Vector3d& error,
                                  const Matrix3d& covariance, double bound) {
    return error.squaredNorm() <=
           factor * factor *
               (bound * bound +
                kNumSigmas * kNumSigmas * VarianceAlong(covariance, error));
  };
  return is_within(difference.center, difference.center_covariance,
                   tolerance) &&
         is_within(difference.rotation_rad, difference.rotation_covariance,
                   tolerance_rad);
}

VelocityChange TypicalChange(const Velocity& a, const Velocity& b,
                             const MotionNoise& noise) {
  return {
      kRelativeChange * std::max(a.linear.norm(), b.linear.norm()) +
          kMinChange * noise.median_step + noise.linear_change,
      kRelativeChange * std::max(a.angular_rad.norm(), b.angular_rad.norm()) +
          kMaxAngle_rad + noise.turn_change_rad};
}

double SquaredChange(const Velocity& a, const Velocity& b,
                     const MotionNoise& noise) {
  const VelocityChange typical = TypicalChange(a, b, noise);
  const auto squared = [](const Vector3d& change, const Matrix3d& covariance,
                          double of_rig) {
    return change.squaredNorm() /
           (of_rig * of_rig + VarianceAlong(covariance, change));
  };
  return squared(a.linear - b.linear, a.linear_covariance + b.linear_covariance,
                 typical.linear) +
         squared(a.angular_rad - b.angular_rad,
                 a.angular_covariance + b.angular_covariance,
                 typical.angular_rad);
}

Vector3d ForwardStep(const MotionHypothesis& hypothesis, double length) {
  return length * hypothesis.free_direction.value_or(Vector3d::Zero());
}

Steps MakeSteps(const std::vector<StepHypotheses>& measured,
                std::vector<double> durations) {
  Steps steps;
  std::vector<double> lengths;
  for (const StepHypotheses& step : measured) {
    for (const MotionHypothesis& h : step) {
      if (h.free_direction) continue;
      lengths.push_back(h.later_from_earlier.translation.norm());
    }
  }
  if (!lengths.empty()) {
    steps.noise.median_step = Median(lengths);
    steps.longest_step = 2.0 * Quantile(lengths, kLongQuantile);
  }
  MeasureDisagreement(measured, &steps.noise);
  MeasureChanges(measured, durations, &steps.noise);
  for (const StepHypotheses& step : measured) {
    steps.candidates.push_back(GroupHypotheses(step, steps.noise));
  }
  steps.durations = std::move(durations);
  return steps;
}

std::vector<Candidate> TryDistances(const Steps& steps, size_t k) {
  std::vector<Candidate> tried;
  for (const Candidate& candidate : steps.candidates[k]) {
    if (!candidate.free_direction || candidate.tried_center) {
      tried.push_back(candidate);
      continue;
    }
    const Vector3d nearest = candidate.later_from_earlier.Center();
    for (const double distance :
         DistancesToTry(steps, steps.Duration(k, candidate.num_steps))) {
      tried.push_back(candidate);
      tried.back().tried_center = nearest + ForwardStep(candidate, distance);
    }
  }
  return tried;
}

}  // namespace mgsfm

// SPDX-License-Identifier: BSD-3-Clause
#include "pair_filtering/motion_candidates.h"

#include <algorithm>
#include <cmath>
#include <utility>

#include "geometry/so3.h"
#include "math/statistics.h"

namespace mgsfm {
namespace {

using Eigen::Vector3d;

// The thresholds of this file at half and twice their values are compared in
// docs/results/constants.md.
//
// The speed changes by this share of the larger one per step: a car that brakes
// hard from 14 m/s loses 0.1 of its speed in 0.3 s.
constexpr double kRelativeChange = 0.1;
// It also changes by this share of the median speed per step, so that a rig can
// stop at walking pace.
constexpr double kMinChange = 0.03;
// Change of the angular velocity, per step: recorded drives of KITTI at 3 Hz
// contain changes of 2.4 degrees on straight roads.
constexpr double kMinTurnChange_rad = DegToRad(3.0);
// The longest distance to try is twice this quantile of the measured distances:
// objects that stay at a constant distance may be most, and a few are
// mismatches.
constexpr double kLongQuantile = 0.9;
// Bounds the cost where most measured distances are zero.
constexpr double kMaxNumDistances = 200.0;
// A step is contested if a hypothesis that explains this share of the matches,
// and others than those before, differs from the one with the largest share.
constexpr double kContestingShare = 0.15;
// And if it goes on in a neighbouring step, within 95 % of the changes.
constexpr double kMaxSquaredChange = 6.0;
// Motions agree within kRelativeTolerance, this share of the median step, and
// this angle.
constexpr double kMinTolerance = 0.04;
constexpr double kMaxAngle_rad = DegToRad(1.0);

std::vector<double> MeasuredLengths(const std::vector<StepHypotheses>& steps) {
  std::vector<double> lengths;
  for (const StepHypotheses& step : steps) {
    for (const MotionHypothesis& h : step) {
      if (h.free_direction) continue;
      lengths.push_back(h.later_from_earlier.translation.norm());
    }
  }
  return lengths;
}

// A pair without parallax.
bool IsStill(const MotionHypothesis& hypothesis) {
  return hypothesis.free_direction && hypothesis.free_direction->isZero(0.0);
}

// Whether a free hypothesis agrees with one with a distance. If it has
// parallax, it never supports standing still.
bool SupportsDistance(const MotionHypothesis& free, const Rigid3& motion,
                      double median_step) {
  return AreEqualMotions(free.ClosestTo(motion.Center()), motion,
                         IsStill(free) ? median_step : 0.0);
}

// Adds a hypothesis to a group that it agrees with.
void Join(const MotionHypothesis& h, Candidate* group) {
  const double weight = h.share / (group->share + h.share);
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
  }
  group->share += h.share;
  group->own_share += h.share;
}

// Compares the points of all motions by depth.
void MeasureNearness(double median_step, std::vector<Candidate>* by_depth) {
  for (Candidate& candidate : *by_depth) {
    for (const Candidate& rival : *by_depth) {
      if (!candidate.reach || !rival.reach ||
          rival.own_share < kContestingShare ||
          AreEqualMotions(candidate.later_from_earlier,
                          rival.later_from_earlier, median_step)) {
        continue;
      }
      candidate.nearness = std::max(candidate.nearness,
                                    std::log(*rival.reach / *candidate.reach));
    }
  }
}

// The free hypotheses, in groups that agree.
std::vector<Candidate> GroupFree(const StepHypotheses& step,
                                 double median_step) {
  StepHypotheses free;
  for (const MotionHypothesis& h : step) {
    if (h.free_direction) free.push_back(h);
  }
  std::stable_sort(free.begin(), free.end(), [](const auto& a, const auto& b) {
    return a.share > b.share;
  });
  const auto agree = [&](const MotionHypothesis& a, const MotionHypothesis& b) {
    const Rigid3 motion = a.ClosestTo(ForwardStep(a, median_step));
    return AreEqualMotions(b.ClosestTo(motion.Center()), motion, median_step);
  };
  std::vector<Candidate> groups;
  for (const MotionHypothesis& h : free) {
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

// Compares a motion by depth with the groups. Both kinds of evidence count
// alike. A group has no matches with depth, but those that agree with it know
// its distance and how near its points are.
void Combine(double median_step, Candidate* by_depth,
             std::vector<Candidate>* groups) {
  const Rigid3 motion = by_depth->later_from_earlier;
  double support = 0.0;
  const Candidate* strongest = nullptr;
  for (Candidate& group : *groups) {
    if (!SupportsDistance(group, motion, median_step)) continue;
    support += group.share;
    group.nearness = group.measured_centers.empty()
                         ? by_depth->nearness
                         : std::min(group.nearness, by_depth->nearness);
    group.measured_centers.push_back(motion.Center());
    if (IsStill(group)) continue;
    if (strongest == nullptr || group.share > strongest->share) {
      strongest = &group;
    }
  }
  by_depth->share = 0.5 * (by_depth->share + std::min(support, 1.0));
  if (strongest == nullptr) return;
  by_depth->by_depth = motion;
  by_depth->later_from_earlier = strongest->ClosestTo(motion.Center());
}

// The hypotheses with a distance, and the groups of free ones.
std::vector<Candidate> GroupHypotheses(const StepHypotheses& step,
                                       double median_step) {
  std::vector<Candidate> candidates;
  for (const MotionHypothesis& h : step) {
    if (!h.free_direction) candidates.push_back({h});
  }
  MeasureNearness(median_step, &candidates);
  std::vector<Candidate> groups = GroupFree(step, median_step);
  if (groups.empty()) return candidates;
  for (Candidate& candidate : candidates) {
    Combine(median_step, &candidate, &groups);
  }
  for (Candidate& group : groups) {
    group.share *= 0.5;
    if (!IsStill(group)) candidates.push_back(std::move(group));
  }
  return candidates;
}

// Whether a rival of the best motion goes on in a neighbouring step, better
// than the best one does. Objects last; errors of depths do not.
bool Continues(const Steps& steps, const Velocity& rival, const Velocity& best,
               size_t neighbour) {
  if (neighbour >= steps.size()) return false;
  const std::vector<Candidate>& candidates = steps.candidates[neighbour];
  const auto change = [&](const Velocity& from, const Candidate& to) {
    return SquaredChange(from, steps.VelocityAfter(from.linear, neighbour, to),
                         steps.median_step);
  };
  return std::any_of(candidates.begin(), candidates.end(),
                     [&](const Candidate& candidate) {
                       const double of_rival = change(rival, candidate);
                       return of_rival <= kMaxSquaredChange &&
                              of_rival < change(best, candidate);
                     });
}

// The distances to try for a step of this duration.
std::vector<double> DistancesToTry(const Steps& steps, double duration) {
  std::vector<double> distances{0.0};
  const double longest = duration * steps.longest_step;
  while (distances.back() < longest) {
    const double change = kRelativeChange * distances.back() +
                          kMinChange * duration * steps.median_step;
    distances.push_back(
        distances.back() +
        std::max(kDistanceSpacing * change, longest / kMaxNumDistances));
  }
  return distances;
}

}  // namespace

Velocity VelocityOf(const Rigid3& later_from_earlier, double duration) {
  return {later_from_earlier.Center() / duration,
          LogSO3(later_from_earlier.rotation) / duration};
}

Rigid3 MotionOf(const Velocity& velocity, double duration) {
  return Rigid3::FromRotationAndCenter(ExpSO3(duration * velocity.angular_rad),
                                       duration * velocity.linear);
}

bool AreEqualMotions(const Rigid3& a, const Rigid3& b, double median_step,
                     double factor) {
  const Vector3d center_a = a.Center(), center_b = b.Center();
  return (center_a - center_b).norm() <=
             factor * (kRelativeTolerance *
                           std::max(center_a.norm(), center_b.norm()) +
                       kMinTolerance * median_step) &&
         AngleBetween(a.rotation, b.rotation) <= factor * kMaxAngle_rad;
}

double SquaredChange(const Velocity& a, const Velocity& b, double median_step) {
  const double scale =
      kRelativeChange * std::max(a.linear.norm(), b.linear.norm()) +
      kMinChange * median_step;
  const double scale_rad =
      kRelativeChange * std::max(a.angular_rad.norm(), b.angular_rad.norm()) +
      kMinTurnChange_rad;
  return (a.linear - b.linear).squaredNorm() / (scale * scale) +
         (a.angular_rad - b.angular_rad).squaredNorm() /
             (scale_rad * scale_rad);
}

Vector3d ForwardStep(const MotionHypothesis& hypothesis, double length) {
  return length * hypothesis.free_direction.value_or(Vector3d::Zero());
}

Steps MakeSteps(const std::vector<StepHypotheses>& measured,
                std::vector<double> durations) {
  Steps steps;
  const std::vector<double> lengths = MeasuredLengths(measured);
  if (!lengths.empty()) {
    steps.median_step = Median(lengths);
    steps.longest_step = 2.0 * Quantile(lengths, kLongQuantile);
  }
  for (const StepHypotheses& step : measured) {
    steps.candidates.push_back(GroupHypotheses(step, steps.median_step));
  }
  steps.durations = std::move(durations);
  return steps;
}

bool HasRivals(const Steps& steps, size_t k) {
  const std::vector<Candidate>& step = steps.candidates[k];
  if (step.empty()) return false;
  const auto best = std::max_element(
      step.begin(), step.end(),
      [](const auto& a, const auto& b) { return a.share < b.share; });
  const Rigid3 motion = best->ClosestTo(
      ForwardStep(*best, steps.durations[k] * steps.median_step));
  const Velocity velocity = VelocityOf(motion, steps.durations[k]);
  return std::any_of(step.begin(), step.end(), [&](const Candidate& h) {
    const Rigid3 rival = h.ClosestTo(motion.Center());
    if (h.own_share < kContestingShare ||
        AreEqualMotions(rival, motion, steps.median_step)) {
      return false;
    }
    const Velocity rival_velocity = VelocityOf(rival, steps.durations[k]);
    return Continues(steps, rival_velocity, velocity, k - 1) ||
           Continues(steps, rival_velocity, velocity, k + 1);
  });
}

std::vector<Candidate> TryDistances(const Steps& steps, size_t k) {
  const std::vector<double> distances =
      DistancesToTry(steps, steps.durations[k]);
  std::vector<Candidate> tried;
  for (const Candidate& candidate : steps.candidates[k]) {
    if (!candidate.free_direction) {
      tried.push_back(candidate);
      continue;
    }
    const Vector3d nearest = candidate.later_from_earlier.Center();
    for (const double distance : distances) {
      tried.push_back(candidate);
      tried.back().tried_center = nearest + ForwardStep(candidate, distance);
    }
  }
  return tried;
}

}  // namespace mgsfm

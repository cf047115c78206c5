// SPDX-License-Identifier: BSD-3-Clause
#include "pair_filtering/motion_continuity.h"

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <limits>
#include <optional>
#include <utility>
#include <vector>

#include "geometry/so3.h"
#include "math/statistics.h"
#include "mgsfm/base/error.h"

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
// A step without a hypothesis counts like one that 2 % of the matches support.
constexpr double kSkipCost = 4.0;
// Weight of the share of matches: a vehicle has four times as many as the
// static scene for tens of frames. With 1, a path followed one for 38 steps.
constexpr double kShareWeight = 0.5;
// A step without a distance fits any speed, so that one with a distance that
// continues the motion must be preferred.
constexpr double kFreeDistanceCost = 1.0;
// Distances that are tried are this many standard deviations of the change of
// velocity apart. The cost of the nearest one is too high by at most 0.16.
constexpr double kDistanceSpacing = 0.8;
// The longest of them is twice this quantile of the measured distances: objects
// that stay at a constant distance may be most, and a few are mismatches.
constexpr double kLongQuantile = 0.9;
// Bounds the cost where most measured distances are zero.
constexpr double kMaxNumDistances = 200.0;
// Bounds the cost, which is linear in it. Half or twice as many change no error
// (docs/results/constants.md).
constexpr size_t kMaxNumSkipped = 7;
// Cost above that of any jump that a skip could avoid.
constexpr double kNeverSkip = 1e4;
// Scale of the loss of the squared change of the motion. Half or twice the
// value changes no error (docs/results/constants.md).
constexpr double kLossScale = 30.0;
// A step is contested if a hypothesis that explains this share of the matches,
// and others than those before, differs from the one with the largest share.
constexpr double kContestingShare = 0.15;
// And if it goes on in a neighbouring step, within 95 % of the changes.
constexpr double kMaxSquaredChange = 6.0;
// Hypotheses agree within this share of the longer step, plus this share of the
// median step, and within this angle.
constexpr double kRelativeTolerance = 0.2;
constexpr double kMinTolerance = 0.04;
constexpr double kMaxAngle_rad = DegToRad(1.0);

// Per step, or per unit of time.
struct Velocity {
  Vector3d linear = Vector3d::Zero();  // of the rig's origin
  Vector3d angular_rad = Vector3d::Zero();
};

Velocity VelocityOf(const Rigid3& later_from_earlier, double duration) {
  return {later_from_earlier.Center() / duration,
          LogSO3(later_from_earlier.rotation) / duration};
}

Rigid3 MotionOf(const Velocity& velocity, double duration) {
  return Rigid3::FromRotationAndCenter(ExpSO3(duration * velocity.angular_rad),
                                       duration * velocity.linear);
}

bool Agree(const Rigid3& a, const Rigid3& b, double median_step) {
  const Vector3d center_a = a.Center(), center_b = b.Center();
  return (center_a - center_b).norm() <=
             kRelativeTolerance * std::max(center_a.norm(), center_b.norm()) +
                 kMinTolerance * median_step &&
         AngleBetween(a.rotation, b.rotation) <= kMaxAngle_rad;
}

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

// The centre of a step of some length in the direction of a hypothesis.
Vector3d ForwardStep(const MotionHypothesis& hypothesis, double length) {
  return length * hypothesis.free_direction.value_or(Vector3d::Zero());
}

// A hypothesis. If its distance is free, one of those that are tried, and the
// centres by matches with depth that agree with it.
struct Candidate : MotionHypothesis {
  std::vector<Vector3d> measured_centers;
  std::optional<Vector3d> tried_center = {};

  // The motion after one with this centre.
  Rigid3 MotionAfter(const Vector3d& center) const {
    return ClosestTo(tried_center.value_or(center));
  }
};

// A pair without parallax.
bool IsStill(const MotionHypothesis& hypothesis) {
  return hypothesis.free_direction && hypothesis.free_direction->isZero(0.0);
}

// Whether a free hypothesis agrees with one with a distance. If it has
// parallax, it never supports standing still.
bool SupportsDistance(const MotionHypothesis& free, const Rigid3& motion,
                      double median_step) {
  return Agree(free.ClosestTo(motion.Center()), motion,
               IsStill(free) ? median_step : 0.0);
}

// The hypotheses with a distance, and the free ones, in groups that agree. A
// group that agrees with a distance supports it, too.
std::vector<Candidate> GroupFree(const StepHypotheses& step,
                                 double median_step) {
  std::vector<Candidate> grouped;
  StepHypotheses free;
  for (const MotionHypothesis& h : step) {
    if (!h.free_direction) grouped.push_back({h, {}});
  }
  const size_t num_measured = grouped.size();
  const auto agree = [&](const MotionHypothesis& a, const MotionHypothesis& b) {
    const Rigid3 motion = a.ClosestTo(ForwardStep(a, median_step));
    return Agree(b.ClosestTo(motion.Center()), motion, median_step);
  };
  for (const MotionHypothesis& h : step) {
    if (h.free_direction) free.push_back(h);
  }
  std::stable_sort(free.begin(), free.end(), [](const auto& a, const auto& b) {
    return a.share > b.share;
  });
  for (const MotionHypothesis& h : free) {
    const auto group =
        std::find_if(grouped.begin() + static_cast<long>(num_measured),
                     grouped.end(), [&](const auto& g) { return agree(g, h); });
    if (group == grouped.end()) {
      grouped.push_back({h, {}});
    } else {
      group->share += h.share;
      group->own_share += h.share;
    }
  }
  if (free.empty()) return grouped;
  // Both kinds of evidence count alike. A group has no matches with depth, but
  // those that agree with it know its distance.
  for (size_t i = 0; i < num_measured; ++i) {
    double support = 0.0;
    const Rigid3& motion = grouped[i].later_from_earlier;
    for (size_t j = num_measured; j < grouped.size(); ++j) {
      if (!SupportsDistance(grouped[j], motion, median_step)) continue;
      support += grouped[j].share;
      grouped[j].measured_centers.push_back(motion.Center());
    }
    grouped[i].share = 0.5 * (grouped[i].share + std::min(support, 1.0));
  }
  for (size_t j = num_measured; j < grouped.size(); ++j) {
    grouped[j].share *= 0.5;
  }
  grouped.erase(std::remove_if(grouped.begin(), grouped.end(), IsStill),
                grouped.end());
  return grouped;
}

// Squared, in standard deviations of changes within one step.
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

// The steps of one sequence, and how long each takes.
struct Steps {
  std::vector<std::vector<Candidate>> candidates;
  std::vector<double> durations;
  double median_step = 0.0;
  double longest_step = 0.0;  // of those that are tried

  size_t size() const { return candidates.size(); }

  // The velocity of a candidate after a step with another one.
  Velocity VelocityAfter(const Vector3d& linear, size_t k,
                         const Candidate& candidate) const {
    return VelocityOf(candidate.MotionAfter(durations[k] * linear),
                      durations[k]);
  }
};

double Loss(double squared) {
  return kLossScale * std::log1p(squared / kLossScale);
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

// Whether a motion other than that with the largest share has support, and goes
// on.
bool HasRivals(const Steps& steps, size_t k) {
  const std::vector<Candidate>& step = steps.candidates[k];
  if (step.empty()) return false;
  const auto best = std::max_element(
      step.begin(), step.end(),
      [](const auto& a, const auto& b) { return a.share < b.share; });
  const Rigid3 motion = best->ClosestTo(ForwardStep(*best, steps.median_step));
  const Velocity velocity = VelocityOf(motion, steps.durations[k]);
  return std::any_of(step.begin(), step.end(), [&](const Candidate& h) {
    const Rigid3 rival = h.ClosestTo(motion.Center());
    if (h.own_share < kContestingShare ||
        Agree(rival, motion, steps.median_step)) {
      return false;
    }
    const Velocity rival_velocity = VelocityOf(rival, steps.durations[k]);
    return Continues(steps, rival_velocity, velocity, k - 1) ||
           Continues(steps, rival_velocity, velocity, k + 1);
  });
}

// The steps near those whose hypotheses disagree.
Mask FindDoubtful(const Mask& has_rivals) {
  Mask is_doubtful(has_rivals.size(), false);
  for (size_t k = 0; k < has_rivals.size(); ++k) {
    if (!has_rivals[k]) continue;
    const size_t begin = k > kMaxNumSkipped ? k - kMaxNumSkipped : 0;
    const size_t end = std::min(has_rivals.size(), k + kMaxNumSkipped + 1);
    is_doubtful.Fill(begin, end, true);
  }
  return is_doubtful;
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

// The candidates, those without a distance once for each distance to try.
std::vector<Candidate> TryDistances(const std::vector<Candidate>& candidates,
                                    const std::vector<double>& distances) {
  std::vector<Candidate> tried;
  for (const Candidate& candidate : candidates) {
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

struct ChosenMotion {
  Velocity velocity;
  MotionHypothesis hypothesis;

  bool HasDistance() const { return !hypothesis.free_direction.has_value(); }
};

// Chooses hypotheses by dynamic programming.
class MotionSearch {
 public:
  MotionSearch(const Steps& steps, const Mask& is_doubtful) : steps_(steps) {
    skip_cost_before_.push_back(0.0);
    for (size_t k = 0; k < steps.size(); ++k) {
      skip_cost_before_.push_back(skip_cost_before_.back() +
                                  (is_doubtful[k] || steps.candidates[k].empty()
                                       ? kSkipCost
                                       : kNeverSkip));
    }
  }

  // Per step: the chosen hypothesis, if any.
  std::vector<std::optional<ChosenMotion>> Solve() {
    for (size_t k = 0; k < steps_.size(); ++k) {
      nodes_.emplace_back();
      for (size_t h = 0; h < steps_.candidates[k].size(); ++h) {
        nodes_.back().push_back(BestNode(k, h));
      }
    }
    return TraceBack();
  }

 private:
  struct Position {
    size_t step, hypothesis;
  };
  struct Node {
    double cost = 0.0;
    std::optional<Position> previous;
    Velocity velocity;
  };

  // The cost of skipping the steps in [begin, end).
  double SkipCost(size_t begin, size_t end) const {
    return skip_cost_before_[end] - skip_cost_before_[begin];
  }

  // The cost of a free distance that differs from those by matches with depth.
  static double CostOfDistance(const Candidate& candidate,
                               const Vector3d& center) {
    double lowest = candidate.measured_centers.empty()
                        ? 0.0
                        : std::numeric_limits<double>::infinity();
    for (const Vector3d& measured : candidate.measured_centers) {
      const double error =
          (center - measured).norm() / (kRelativeTolerance * measured.norm());
      lowest = std::min(lowest, error * error);
    }
    return Loss(lowest);
  }

  Node BestNode(size_t k, size_t h) const {
    const Candidate& hypothesis = steps_.candidates[k][h];
    Node best = AfterGap(k);
    best.velocity = VelocityOf(
        hypothesis.MotionAfter(ForwardStep(hypothesis, steps_.median_step)),
        steps_.durations[k]);
    const size_t first = k > kMaxNumSkipped ? k - 1 - kMaxNumSkipped : 0;
    for (size_t previous = first; previous < k; ++previous) {
      for (size_t g = 0; g < steps_.candidates[previous].size(); ++g) {
        const Node& node = nodes_[previous][g];
        if (node.cost + SkipCost(previous + 1, k) >= best.cost) continue;
        const Velocity velocity =
            steps_.VelocityAfter(node.velocity.linear, k, hypothesis);
        const double cost =
            node.cost +
            Loss(SquaredChange(node.velocity, velocity, steps_.median_step)) +
            CostOfDistance(hypothesis, steps_.durations[k] * velocity.linear) +
            SkipCost(previous + 1, k);
        if (cost >= best.cost) continue;
        best = {cost, Position{previous, g}, velocity};
      }
    }
    best.cost -= kShareWeight * std::log(hypothesis.share);
    if (hypothesis.free_direction) best.cost += kFreeDistanceCost;
    return best;
  }

  // The start of the sequence. After more than kMaxNumSkipped steps without any
  // hypothesis, the best node before them: velocities across such a gap are not
  // compared.
  Node AfterGap(size_t k) const {
    Node best{SkipCost(0, k), std::nullopt, {}};
    size_t before = k;
    while (before > 0 && steps_.candidates[before - 1].empty()) --before;
    if (before == 0 || k - before <= kMaxNumSkipped) return best;
    for (size_t g = 0; g < steps_.candidates[before - 1].size(); ++g) {
      const double cost = nodes_[before - 1][g].cost + SkipCost(before, k);
      if (cost < best.cost) best = {cost, Position{before - 1, g}, {}};
    }
    return best;
  }

  std::vector<std::optional<ChosenMotion>> TraceBack() const {
    std::optional<Position> position;
    double lowest = 0.0;
    for (size_t k = 0; k < nodes_.size(); ++k) {
      for (size_t h = 0; h < nodes_[k].size(); ++h) {
        const double cost = nodes_[k][h].cost + SkipCost(k + 1, nodes_.size());
        if (!position || cost < lowest) {
          lowest = cost;
          position = Position{k, h};
        }
      }
    }
    std::vector<std::optional<ChosenMotion>> chosen(steps_.size());
    while (position) {
      const auto [k, h] = *position;
      chosen[k] = ChosenMotion{nodes_[k][h].velocity, steps_.candidates[k][h]};
      position = nodes_[k][h].previous;
    }
    return chosen;
  }

  const Steps& steps_;
  std::vector<double> skip_cost_before_;  // sums over the steps before each
  std::vector<std::vector<Node>> nodes_;
};

// Interpolates the distances that the chosen hypotheses do not have.
void InterpolateDistances(const std::vector<double>& durations,
                          std::vector<std::optional<ChosenMotion>>* chosen) {
  const auto has_distance = [](const std::optional<ChosenMotion>& motion) {
    return motion && motion->HasDistance();
  };
  auto before = chosen->end();
  for (auto it = chosen->begin(); it != chosen->end(); ++it) {
    if (has_distance(*it)) before = it;
    if (!*it || (*it)->HasDistance()) continue;
    const auto after = std::find_if(it, chosen->end(), has_distance);
    if (before == chosen->end() && after == chosen->end()) continue;
    Vector3d linear;
    if (before == chosen->end() || after == chosen->end()) {
      linear = (*(before == chosen->end() ? after : before))->velocity.linear;
    } else {
      const auto weight = static_cast<double>(it - before) /
                          static_cast<double>(after - before);
      linear = (1.0 - weight) * (*before)->velocity.linear +
               weight * (*after)->velocity.linear;
    }
    const double duration = durations[it - chosen->begin()];
    (*it)->velocity =
        VelocityOf((*it)->hypothesis.ClosestTo(duration * linear), duration);
  }
}

Velocity Mean(const Velocity& a, const Velocity& b) {
  return {0.5 * (a.linear + b.linear), 0.5 * (a.angular_rad + b.angular_rad)};
}

// Places of all frames of one sequence. Where nothing suggests that hypotheses
// were outvoted, a step without any is unknown.
std::vector<RigPath::Place> FollowMotion(
    const std::vector<std::optional<ChosenMotion>>& chosen,
    const std::vector<double>& durations, const Mask& is_doubtful,
    int first_stretch) {
  std::vector<RigPath::Place> places{{first_stretch, {}}};
  std::optional<size_t> previous;
  for (size_t k = 0; k < chosen.size(); ++k) {
    RigPath::Place next = places.back();
    size_t following = k;
    while (following < chosen.size() && !chosen[following]) ++following;
    std::optional<Velocity> velocity;
    if (chosen[k]) {
      velocity = chosen[k]->velocity;
      previous = k;
    } else if (is_doubtful[k] && following < chosen.size() && previous &&
               following - *previous - 1 <= kMaxNumSkipped) {
      velocity = Mean(chosen[*previous]->velocity, chosen[following]->velocity);
    }
    if (velocity) {
      next.rig_from_start =
          MotionOf(*velocity, durations[k]) * next.rig_from_start;
    } else {
      ++next.stretch;
    }
    places.push_back(next);
  }
  return places;
}

// Adds the places of one sequence. Returns the number of the next stretch.
int FollowSequence(const TemporalOrder& order, const std::vector<int>& sequence,
                   const std::vector<StepHypotheses>& measured,
                   int first_stretch, RigPath* path) {
  if (sequence.size() < 2) return first_stretch;
  MGSFM_CHECK_EQ(measured.size() + 1, sequence.size());
  Steps steps;
  const std::vector<double> lengths = MeasuredLengths(measured);
  if (!lengths.empty()) {
    steps.median_step = Median(lengths);
    steps.longest_step = 2.0 * Quantile(lengths, kLongQuantile);
  }
  for (size_t k = 0; k < measured.size(); ++k) {
    steps.candidates.push_back(GroupFree(measured[k], steps.median_step));
    steps.durations.push_back(order.Duration(sequence[k], sequence[k + 1]));
  }
  path->median_step = std::max(path->median_step, steps.median_step);
  Mask has_rivals(steps.size(), false);
  for (size_t k = 0; k < steps.size(); ++k) {
    has_rivals[k] = HasRivals(steps, k);
    if (!has_rivals[k]) continue;
    path->is_contested[sequence[k]] = true;
    path->is_contested[sequence[k + 1]] = true;
  }
  const Mask is_doubtful = FindDoubtful(has_rivals);
  for (size_t k = 0; k < steps.size(); ++k) {
    if (!is_doubtful[k]) continue;
    steps.candidates[k] = TryDistances(
        steps.candidates[k], DistancesToTry(steps, steps.durations[k]));
  }
  auto chosen = MotionSearch(steps, is_doubtful).Solve();
  InterpolateDistances(steps.durations, &chosen);
  const auto places =
      FollowMotion(chosen, steps.durations, is_doubtful, first_stretch);
  for (size_t k = 0; k < sequence.size(); ++k) {
    path->of_frame[sequence[k]] = places[k];
    path->is_interpolated[sequence[k]] =
        k > 0 && (!chosen[k - 1] || !chosen[k - 1]->HasDistance());
  }
  return places.back().stretch + 1;
}

}  // namespace

Rigid3 MotionHypothesis::ClosestTo(const Vector3d& center) const {
  if (!free_direction) return later_from_earlier;
  const Vector3d nearest = later_from_earlier.Center();
  const double distance = std::max(0.0, free_direction->dot(center - nearest));
  return Rigid3::FromRotationAndCenter(later_from_earlier.rotation,
                                       nearest + distance * *free_direction);
}

bool RigPath::AreSimilar(const Rigid3& a, const Rigid3& b) const {
  return Agree(a, b, median_step);
}

RigPath FindRigPath(
    const TemporalOrder& order, int num_frames,
    const std::vector<std::vector<StepHypotheses>>& hypotheses) {
  MGSFM_CHECK_EQ(hypotheses.size(), order.sequences().size());
  RigPath path;
  path.of_frame.resize(num_frames);
  path.is_contested = Mask(num_frames, false);
  path.is_interpolated = Mask(num_frames, false);
  int num_stretches = 0;
  for (size_t s = 0; s < hypotheses.size(); ++s) {
    num_stretches = FollowSequence(order, order.sequences()[s], hypotheses[s],
                                   num_stretches, &path);
  }
  return path;
}

}  // namespace mgsfm

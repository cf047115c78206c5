// SPDX-License-Identifier: BSD-3-Clause
#include "pair_filtering/motion_continuity.h"

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <optional>
#include <utility>
#include <vector>

#include "geometry/so3.h"
#include "math/statistics.h"
#include "mgsfm/base/error.h"

namespace mgsfm {
namespace {

using Eigen::Vector3d;

// Of the larger speed, per step: a car that brakes hard from 14 m/s loses 0.1
// of its speed in 0.3 s.
constexpr double kRelativeChange = 0.1;
// Of the median speed, per step: allows a stop at walking pace.
constexpr double kMinChange = 0.03;
// Of the angular velocity, per step: recorded drives of KITTI at 3 Hz contain
// changes of 2.4 degrees on straight roads.
constexpr double kMinTurnChange_rad = DegToRad(3.0);
// A step without a hypothesis counts like one that 2 % of the matches support.
constexpr double kSkipCost = 4.0;
constexpr size_t kMaxNumSkipped = 7;
// More than any jumps that skipping a step could avoid.
constexpr double kNeverSkip = 1e4;
constexpr double kLossScale = 30.0;
// A step is contested if a hypothesis that explains this share of the matches,
// and others than those before, differs from the one with the largest share.
constexpr double kContestingShare = 0.15;
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

double MedianLength(const std::vector<StepHypotheses>& steps) {
  std::vector<double> lengths;
  for (const StepHypotheses& step : steps) {
    for (const MotionHypothesis& h : step) {
      lengths.push_back(h.later_from_earlier.translation.norm());
    }
  }
  return lengths.empty() ? 0.0 : Median(std::move(lengths));
}

bool HasRivals(const StepHypotheses& step, double median_step) {
  if (step.empty()) return false;
  const auto best = std::max_element(
      step.begin(), step.end(),
      [](const auto& a, const auto& b) { return a.share < b.share; });
  return std::any_of(step.begin(), step.end(), [&](const auto& h) {
    return h.own_share >= kContestingShare &&
           !Agree(h.later_from_earlier, best->later_from_earlier, median_step);
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

// Chooses hypotheses by dynamic programming.
class MotionSearch {
 public:
  // `durations` are those of the steps.
  MotionSearch(const std::vector<StepHypotheses>& steps,
               const std::vector<double>& durations, const Mask& is_doubtful,
               double median_step)
      : steps_(steps), median_step_(median_step) {
    skip_cost_before_.push_back(0.0);
    for (size_t k = 0; k < steps.size(); ++k) {
      skip_cost_before_.push_back(
          skip_cost_before_.back() +
          (is_doubtful[k] || steps[k].empty() ? kSkipCost : kNeverSkip));
      velocities_.emplace_back();
      for (const MotionHypothesis& h : steps[k]) {
        velocities_.back().push_back(
            VelocityOf(h.later_from_earlier, durations[k]));
      }
    }
  }

  // Per step: the velocity of the chosen hypothesis, if any.
  std::vector<std::optional<Velocity>> Solve() {
    for (size_t k = 0; k < steps_.size(); ++k) {
      nodes_.emplace_back();
      for (size_t h = 0; h < steps_[k].size(); ++h) {
        nodes_.back().push_back(BestNode(k, h));
      }
      best_until_.push_back(BestUntil(k));
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
  };

  // Of the steps in [begin, end).
  double SkipCost(size_t begin, size_t end) const {
    return skip_cost_before_[end] - skip_cost_before_[begin];
  }

  double CostOfChange(const Velocity& a, const Velocity& b) const {
    const double scale =
        kRelativeChange * std::max(a.linear.norm(), b.linear.norm()) +
        kMinChange * median_step_;
    const double scale_rad =
        kRelativeChange * std::max(a.angular_rad.norm(), b.angular_rad.norm()) +
        kMinTurnChange_rad;
    const double cost =
        (a.linear - b.linear).squaredNorm() / (scale * scale) +
        (a.angular_rad - b.angular_rad).squaredNorm() / (scale_rad * scale_rad);
    return kLossScale * std::log1p(cost / kLossScale);
  }

  // After more than kMaxNumSkipped steps without a hypothesis, the velocities
  // before and after are not compared.
  Node BestNode(size_t k, size_t h) const {
    Node best{SkipCost(0, k), std::nullopt};
    const size_t first = k > kMaxNumSkipped ? k - 1 - kMaxNumSkipped : 0;
    if (first > 0 && best_until_[first - 1].previous) {
      const Node& far = best_until_[first - 1];
      const double cost = far.cost + SkipCost(far.previous->step + 1, k);
      if (cost < best.cost) best = {cost, far.previous};
    }
    for (size_t previous = first; previous < k; ++previous) {
      for (size_t g = 0; g < steps_[previous].size(); ++g) {
        const double cost =
            nodes_[previous][g].cost +
            CostOfChange(velocities_[previous][g], velocities_[k][h]) +
            SkipCost(previous + 1, k);
        if (cost < best.cost) best = {cost, Position{previous, g}};
      }
    }
    best.cost -= std::log(steps_[k][h].share);
    return best;
  }

  // The node up to step k after which all later steps cost least: `previous` is
  // the node itself.
  Node BestUntil(size_t k) const {
    Node best;
    if (k > 0) best = best_until_[k - 1];
    for (size_t h = 0; h < nodes_[k].size(); ++h) {
      const double cost = nodes_[k][h].cost;
      if (!best.previous ||
          cost < best.cost + SkipCost(best.previous->step + 1, k + 1)) {
        best = {cost, Position{k, h}};
      }
    }
    return best;
  }

  std::vector<std::optional<Velocity>> TraceBack() const {
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
    std::vector<std::optional<Velocity>> chosen(steps_.size());
    while (position) {
      chosen[position->step] =
          velocities_[position->step][position->hypothesis];
      position = nodes_[position->step][position->hypothesis].previous;
    }
    return chosen;
  }

  const std::vector<StepHypotheses>& steps_;
  const double median_step_;
  std::vector<std::vector<Velocity>> velocities_;
  std::vector<double> skip_cost_before_;  // sums over the steps before each
  std::vector<std::vector<Node>> nodes_;
  std::vector<Node> best_until_;  // per step
};

Velocity Mean(const Velocity& a, const Velocity& b) {
  return {0.5 * (a.linear + b.linear), 0.5 * (a.angular_rad + b.angular_rad)};
}

// Places of all frames of one sequence. Where nothing suggests that hypotheses
// were outvoted, a step without any is unknown.
std::vector<RigPath::Place> FollowMotion(
    const std::vector<std::optional<Velocity>>& chosen,
    const std::vector<double>& durations, const Mask& is_doubtful,
    int first_stretch) {
  std::vector<RigPath::Place> places{{first_stretch, {}}};
  std::optional<size_t> previous;
  for (size_t k = 0; k < chosen.size(); ++k) {
    RigPath::Place next = places.back();
    size_t following = k;
    while (following < chosen.size() && !chosen[following]) ++following;
    std::optional<Velocity> velocity = chosen[k];
    if (velocity) {
      previous = k;
    } else if (is_doubtful[k] && following < chosen.size() && previous &&
               following - *previous - 1 <= kMaxNumSkipped) {
      velocity = Mean(*chosen[*previous], *chosen[following]);
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
                   const std::vector<StepHypotheses>& steps, int first_stretch,
                   RigPath* path) {
  if (sequence.size() < 2) return first_stretch;
  MGSFM_CHECK_EQ(steps.size() + 1, sequence.size());
  const double median_step = MedianLength(steps);
  path->median_step = std::max(path->median_step, median_step);
  std::vector<double> durations;
  Mask has_rivals(steps.size(), false);
  for (size_t k = 0; k < steps.size(); ++k) {
    durations.push_back(order.Duration(sequence[k], sequence[k + 1]));
    has_rivals[k] = HasRivals(steps[k], median_step);
    if (!has_rivals[k]) continue;
    path->is_contested[sequence[k]] = true;
    path->is_contested[sequence[k + 1]] = true;
  }
  const Mask is_doubtful = FindDoubtful(has_rivals);
  const auto chosen =
      MotionSearch(steps, durations, is_doubtful, median_step).Solve();
  const auto places =
      FollowMotion(chosen, durations, is_doubtful, first_stretch);
  for (size_t k = 0; k < sequence.size(); ++k) {
    path->of_frame[sequence[k]] = places[k];
  }
  return places.back().stretch + 1;
}

}  // namespace

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
  int num_stretches = 0;
  for (size_t s = 0; s < hypotheses.size(); ++s) {
    num_stretches = FollowSequence(order, order.sequences()[s], hypotheses[s],
                                   num_stretches, &path);
  }
  return path;
}

}  // namespace mgsfm

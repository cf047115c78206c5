// SPDX-License-Identifier: BSD-3-Clause
#include "moving_objects/motion_continuity.h"

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <limits>
#include <numeric>
#include <optional>
#include <utility>
#include <vector>

#include "mgsfm/base/error.h"
#include "moving_objects/motion_candidates.h"

namespace mgsfm {
namespace {

using Eigen::Matrix3d;
using Eigen::Vector3d;
using ChosenMotions = std::vector<std::optional<ChosenMotion>>;

// docs/results/constants.md shows the sensitivity to these thresholds.
//
// Bounds the cost, which is linear in it. Half or twice as many change no
// error.
constexpr size_t kMaxNumSkipped = 7;
// A step without a hypothesis counts like one that 2 % of the matches support.
constexpr double kSkipCost = 4.0;
// Cost above that of any jump that a skip could avoid.
constexpr double kNeverSkip = 1e4;
// Weight of the fraction of matches: a vehicle has four times as many as the
// static scene for tens of frames. With 1, the path followed a vehicle for 38
// steps.
constexpr double kShareWeight = 0.5;
// Weight of the logarithm of the relative reach. On eight drives, 38 steps are
// unknown with 1 and 12 with 2 or 3, and 20 are wrong with each.
constexpr double kNearnessWeight = 2.0;
// Prefers steps with a distance that continues the motion: a step without a
// distance fits any speed.
constexpr double kFreeDistanceCost = 1.0;
// Scale of the loss of the squared change of the motion. Half or twice the
// value changes no error.
constexpr double kLossScale = 30.0;
// Motions are different beyond this many tolerances. With 1.5 and 3, 79 and 50
// instead of 64 % of the wrong steps of 200 drives had a margin below 3, and
// 1.9 and 1.0 instead of 1.3 % of the right ones.
constexpr double kDistinct = 2.0;
// A step is ambiguous if the odds of another motion exceed 1 in 20.
constexpr double kMinMargin = 3.0;
// Pairs of neighbors bridge fewer steps. 28 of 450 groups of ambiguous steps
// on 200 drives were larger.
constexpr size_t kMinNumAmbiguous = 3;
// Maximum number of steps between ambiguous steps of a group.
constexpr size_t kMaxNumBetween = 2;
constexpr double kInfinity = std::numeric_limits<double>::infinity();

double Loss(double squared) {
  return kLossScale * std::log1p(squared / kLossScale);
}

// Chooses hypotheses by dynamic programming.
class MotionSearch {
 public:
  MotionSearch(const Steps& steps, const Mask& is_doubtful) : steps_(steps) {
    size_t with_candidates = 0;  // the last step before
    skip_cost_before_.push_back(0.0);
    for (size_t k = 0; k < steps.size(); ++k) {
      const bool is_empty = steps.candidates[k].empty();
      skip_cost_before_.push_back(
          skip_cost_before_.back() +
          (is_doubtful[k] || is_empty ? kSkipCost : kNeverSkip));
      first_before_.push_back(
          std::min(with_candidates, k - std::min(k, kMaxNumSkipped + 1)));
      if (!is_empty) with_candidates = k;
    }
  }

  MotionChoice Solve() {
    for (size_t k = 0; k < steps_.size(); ++k) {
      nodes_.emplace_back();
      for (const Candidate& candidate : steps_.candidates[k]) {
        nodes_.back().push_back(BestNode(k, candidate));
      }
    }
    MotionChoice choice;
    choice.motions = TraceBack(&choice.cost);
    choice.margins = Margins(choice);
    return choice;
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

  // The cost of the difference between a free distance and the distances by
  // depth.
  static double CostOfDistance(const Candidate& candidate,
                               const Vector3d& center) {
    double lowest = candidate.measured.empty() ? 0.0 : kInfinity;
    for (const MeasuredMotion& motion : candidate.measured) {
      const Vector3d measured = motion.later_from_earlier.Center();
      const Vector3d error = center - measured;
      const double tolerance = kRelativeTolerance * measured.norm();
      lowest = std::min(lowest,
                        error.squaredNorm() /
                            (tolerance * tolerance +
                             VarianceAlong(motion.center_covariance, error)));
    }
    return Loss(lowest);
  }

  // The cost of a candidate of step k with this velocity, after a node.
  double CostOfChange(const Node& node, const Velocity& velocity, size_t k,
                      const Candidate& candidate) const {
    return Loss(SquaredChange(node.velocity, velocity, steps_.noise)) +
           CostOfDistance(candidate, steps_.durations[k] * velocity.linear);
  }

  static double OwnCost(const Candidate& candidate) {
    return -kShareWeight * std::log(candidate.share) +
           kNearnessWeight * candidate.nearness +
           (candidate.free_direction ? kFreeDistanceCost : 0.0);
  }

  Node BestNode(size_t k, const Candidate& candidate) const {
    Node best{SkipCost(0, k),
              {},
              VelocityOf(steps_.MotionOf(k, candidate), steps_.durations[k])};
    for (size_t previous = first_before_[k]; previous < k; ++previous) {
      for (size_t g = 0; g < nodes_[previous].size(); ++g) {
        const Node& node = nodes_[previous][g];
        const double skipped = node.cost + SkipCost(previous + 1, k);
        if (skipped >= best.cost) continue;
        const Velocity velocity =
            steps_.VelocityAfter(node.velocity.linear, k, candidate);
        const double cost =
            skipped + CostOfChange(node, velocity, k, candidate);
        if (cost < best.cost) best = {cost, Position{previous, g}, velocity};
      }
    }
    best.cost += OwnCost(candidate);
    return best;
  }

  ChosenMotions TraceBack(double* lowest) const {
    std::optional<Position> position;
    *lowest = SkipCost(0, nodes_.size());
    for (size_t k = 0; k < nodes_.size(); ++k) {
      for (size_t h = 0; h < nodes_[k].size(); ++h) {
        const double cost = nodes_[k][h].cost + SkipCost(k + 1, nodes_.size());
        if (!position || cost < *lowest) {
          *lowest = cost;
          position = Position{k, h};
        }
      }
    }
    ChosenMotions chosen(steps_.size());
    while (position) {
      const auto [k, h] = *position;
      chosen[k] = ChosenMotion{nodes_[k][h].velocity, steps_.candidates[k][h]};
      position = nodes_[k][h].previous;
    }
    return chosen;
  }

  // The lowest cost of all steps after a node of step k, given those of the
  // nodes of later steps.
  double CostAfter(size_t k, const Node& node,
                   const std::vector<std::vector<double>>& after) const {
    double lowest = SkipCost(k + 1, nodes_.size());
    for (size_t next = k + 1; next < nodes_.size() && first_before_[next] <= k;
         ++next) {
      for (size_t g = 0; g < nodes_[next].size(); ++g) {
        const Candidate& candidate = steps_.candidates[next][g];
        const double cost =
            SkipCost(k + 1, next) + OwnCost(candidate) + after[next][g];
        if (cost >= lowest) continue;
        const Velocity velocity =
            steps_.VelocityAfter(node.velocity.linear, next, candidate);
        lowest = std::min(lowest,
                          cost + CostOfChange(node, velocity, next, candidate));
      }
    }
    return lowest;
  }

  std::vector<double> Margins(const MotionChoice& choice) const {
    std::vector<std::vector<double>> after(nodes_.size());
    std::vector<double> margins(nodes_.size(), kInfinity);
    for (size_t k = nodes_.size(); k-- > 0;) {
      const auto& chosen = choice.motions[k];
      for (size_t h = 0; h < nodes_[k].size(); ++h) {
        const Node& node = nodes_[k][h];
        after[k].push_back(CostAfter(k, node, after));
        const double margin = node.cost + after[k].back() - choice.cost;
        if (margin >= margins[k]) continue;
        if (!chosen || IsAnother(*chosen, k, steps_.candidates[k][h], node)) {
          margins[k] = margin;
        }
      }
    }
    return margins;
  }

  // Whether a candidate of step k is another motion than the chosen one. A
  // direction without a distance is the same motion if it agrees with the
  // chosen one at the closest distance, unless its matches contradict the
  // chosen distance. Without `compare`, they always do.
  bool IsAnother(const ChosenMotion& chosen, size_t k,
                 const Candidate& candidate, const Node& node) const {
    if (AreSimilar(chosen.velocity, node.velocity)) return false;
    if (!candidate.free_direction) return true;
    const MeasuredMotion motion =
        mgsfm::MotionOf(chosen.velocity, steps_.durations[k]);
    if (!AreEqualMotions(
            candidate.ClosestTo(motion.later_from_earlier.Center()), motion,
            steps_.noise, kDistinct)) {
      return true;
    }
    return chosen.HasDistance() &&
           (!steps_.compare ||
            steps_.compare(k, steps_.MotionOf(k, candidate).later_from_earlier,
                           motion.later_from_earlier)
                    .unexplained >= kContestingShare);
  }

  bool AreSimilar(const Velocity& a, const Velocity& b) const {
    return AreEqualMotions(MotionOf(a, 1.0), MotionOf(b, 1.0), steps_.noise,
                           kDistinct);
  }

  const Steps& steps_;
  std::vector<double> skip_cost_before_;  // sums over the steps before each
  // Per step: the first one that may come before it. More steps than
  // kMaxNumSkipped may be skipped if none of them has a hypothesis.
  std::vector<size_t> first_before_;
  std::vector<std::vector<Node>> nodes_;
};

MotionNoise Larger(const MotionNoise& a, const MotionNoise& b) {
  return {std::max(a.median_step, b.median_step),
          std::max(a.rotation_rad, b.rotation_rad),
          std::max(a.relative_center, b.relative_center),
          std::max(a.turn_change_rad, b.turn_change_rad),
          std::max(a.linear_change, b.linear_change)};
}

// The steps near those whose hypotheses disagree.
Mask FindDoubtful(const Mask& has_rivals) {
  Mask is_doubtful(has_rivals.size(), false);
  for (size_t k = 0; k < has_rivals.size(); ++k) {
    if (!has_rivals[k]) continue;
    is_doubtful.Fill(k - std::min(k, kMaxNumSkipped),
                     std::min(has_rivals.size(), k + kMaxNumSkipped + 1), true);
  }
  return is_doubtful;
}

// The groups of steps whose motion is ambiguous.
Mask FindAmbiguous(const std::vector<double>& margins,
                   const Mask& is_doubtful) {
  Mask is_ambiguous(margins.size(), false);
  std::vector<size_t> group;
  const auto finish = [&] {
    if (group.size() >= kMinNumAmbiguous) {
      is_ambiguous.Fill(group.front(), group.back() + 1, true);
    }
    group.clear();
  };
  for (size_t k = 0; k < margins.size(); ++k) {
    if (!is_doubtful[k] || margins[k] >= kMinMargin) continue;
    if (!group.empty() && k - group.back() > kMaxNumBetween + 1) finish();
    group.push_back(k);
  }
  finish();
  return is_ambiguous;
}

// Restores motions by depth whose rotation and direction were replaced by those
// of image pairs for the search, because pairs next to vehicles are biased.
void RestoreMotionsByDepth(const std::vector<double>& durations,
                           ChosenMotions* chosen) {
  for (size_t k = 0; k < chosen->size(); ++k) {
    auto& motion = (*chosen)[k];
    if (!motion || !motion->candidate.by_depth) continue;
    motion->velocity = VelocityOf(*motion->candidate.by_depth, durations[k]);
  }
}

// Interpolates the distances that the chosen hypotheses lack. Errors grow with
// the number of steps to a known distance.
void InterpolateDistances(const Steps& steps, ChosenMotions* chosen) {
  std::vector<size_t> known;  // steps with a distance
  for (size_t k = 0; k < chosen->size(); ++k) {
    if ((*chosen)[k] && (*chosen)[k]->HasDistance()) known.push_back(k);
  }
  if (known.empty()) return;
  for (size_t k = 0; k < chosen->size(); ++k) {
    auto& motion = (*chosen)[k];
    if (!motion || motion->HasDistance()) continue;
    const auto next = std::lower_bound(known.begin(), known.end(), k);
    const size_t after = next == known.end() ? known.back() : *next;
    const size_t before = next == known.begin() ? after : *(next - 1);
    const Velocity& first = (*chosen)[before]->velocity;
    const Velocity& last = (*chosen)[after]->velocity;
    const auto steps_from = [k](size_t other) {
      return std::abs(static_cast<double>(k) - static_cast<double>(other));
    };
    const double weight =
        before < after
            ? steps_from(before) / static_cast<double>(after - before)
            : 0.0;
    const Vector3d linear =
        (1.0 - weight) * first.linear + weight * last.linear;
    const double duration = steps.durations[k];
    const double change = TypicalChange(first, last, steps.noise).linear;
    motion->velocity =
        VelocityOf(motion->candidate.ClosestTo(duration * linear), duration);
    motion->velocity.linear_covariance +=
        std::min(steps_from(before), steps_from(after)) * change * change *
        Matrix3d::Identity();
  }
}

// The covariances of motions do not include errors that all steps share, such
// as a wrong calibration. The disagreement of their measurements reveals these.
void AddDisagreement(const Steps& steps, ChosenMotions* chosen) {
  for (size_t k = 0; k < chosen->size(); ++k) {
    if (!(*chosen)[k]) continue;
    Velocity& velocity = (*chosen)[k]->velocity;
    const double turn = steps.noise.rotation_rad / steps.durations[k];
    const double change = steps.noise.relative_center * velocity.linear.norm();
    velocity.angular_covariance += turn * turn * Matrix3d::Identity();
    velocity.linear_covariance += change * change * Matrix3d::Identity();
  }
}

// The velocity between two steps, as far from both as it may change.
Velocity Mean(const Velocity& a, const Velocity& b, const MotionNoise& noise) {
  const VelocityChange change = TypicalChange(a, b, noise);
  return {0.5 * (a.linear + b.linear), 0.5 * (a.angular_rad + b.angular_rad),
          change.linear * change.linear * Matrix3d::Identity() +
              0.25 * (a.linear_covariance + b.linear_covariance),
          change.angular_rad * change.angular_rad * Matrix3d::Identity() +
              0.25 * (a.angular_covariance + b.angular_covariance)};
}

// Places all frames of one sequence. A step is unknown if it is ambiguous, or
// if it has no hypothesis and there is no sign that the true one was outvoted.
// Steps before the first hypothesis and after the last one are not ambiguous:
// no motions on both sides of them contradict the pairs.
std::vector<RigPath::Place> FollowMotion(const ChosenMotions& chosen,
                                         const Steps& steps,
                                         const Mask& is_doubtful,
                                         const Mask& is_ambiguous,
                                         int first_stretch) {
  const std::vector<double>& durations = steps.durations;
  std::vector<RigPath::Place> places{{first_stretch}};
  std::optional<size_t> previous;
  const auto are_few = [&](size_t begin, size_t end) {
    const double duration = std::accumulate(durations.begin() + begin,
                                            durations.begin() + end, 0.0);
    return end - begin <= kMaxNumSkipped &&
           std::round(duration) <= static_cast<double>(kMaxNumSkipped);
  };
  for (size_t k = 0; k < chosen.size(); ++k) {
    RigPath::Place next = places.back();
    size_t following = k;
    while (following < chosen.size() && !chosen[following]) ++following;
    std::optional<Velocity> velocity;
    if (chosen[k]) {
      velocity = chosen[k]->velocity;
      previous = k;
    } else if (is_doubtful[k] && following < chosen.size() && previous &&
               are_few(*previous + 1, following)) {
      velocity = Mean(chosen[*previous]->velocity, chosen[following]->velocity,
                      steps.noise);
    }
    if (velocity && !is_ambiguous[k]) {
      next.Move(MotionOf(*velocity, durations[k]));
    } else {
      ++next.stretch;
      const bool is_enclosed = previous && following < chosen.size();
      if (is_ambiguous[k] || (is_doubtful[k] && is_enclosed)) {
        ++next.num_ambiguous;
      }
    }
    places.push_back(next);
  }
  return places;
}

// Adds the places of one sequence. Returns the number of the next segment.
int FollowSequence(const TemporalOrder& order, const std::vector<int>& sequence,
                   const std::vector<StepHypotheses>& measured,
                   const MotionComparison& compare, int first_stretch,
                   RigPath* path) {
  if (sequence.size() < 2) return first_stretch;
  MGSFM_CHECK_EQ(measured.size() + 1, sequence.size());
  std::vector<double> durations;
  for (size_t k = 0; k < measured.size(); ++k) {
    durations.push_back(order.Duration(sequence[k], sequence[k + 1]));
  }
  Steps steps = MakeSteps(measured, std::move(durations));
  if (compare) {
    steps.compare = [&](size_t k, const Rigid3& a, const Rigid3& b) {
      return compare(sequence[k], sequence[k + 1], a, b);
    };
  }
  path->noise = Larger(path->noise, steps.noise);
  Mask has_rivals(steps.size(), false);
  for (size_t k = 0; k < steps.size(); ++k) {
    has_rivals[k] = HasRivals(steps, k);
    if (!has_rivals[k]) continue;
    path->is_contested[sequence[k]] = true;
    path->is_contested[sequence[k + 1]] = true;
  }
  const Mask is_doubtful = FindDoubtful(has_rivals);
  for (size_t k = 0; k < steps.size(); ++k) {
    if (is_doubtful[k]) steps.candidates[k] = TryDistances(steps, k);
  }
  MotionChoice choice = ChooseMotions(steps, is_doubtful);
  ChosenMotions& chosen = choice.motions;
  RestoreMotionsByDepth(steps.durations, &chosen);
  InterpolateDistances(steps, &chosen);
  AddDisagreement(steps, &chosen);
  const auto places =
      FollowMotion(chosen, steps, is_doubtful,
                   FindAmbiguous(choice.margins, is_doubtful), first_stretch);
  for (size_t k = 0; k < sequence.size(); ++k) {
    path->of_frame[sequence[k]] = places[k];
    if (k == 0) continue;
    path->is_interpolated[sequence[k]] =
        !chosen[k - 1] || !chosen[k - 1]->HasDistance();
    path->num_unknown[sequence[k]] =
        path->num_unknown[sequence[k - 1]] + (chosen[k - 1] ? 0 : 1);
  }
  return places.back().stretch + 1;
}

}  // namespace

MotionChoice ChooseMotions(const Steps& steps, const Mask& is_doubtful) {
  MGSFM_CHECK_EQ(is_doubtful.size(), steps.size());
  return MotionSearch(steps, is_doubtful).Solve();
}

void RigPath::Place::Move(const MeasuredMotion& step) {
  const Matrix3d earlier = rig_from_start.rotation.toRotationMatrix();
  rig_from_start = step.later_from_earlier * rig_from_start;
  const Matrix3d later = rig_from_start.rotation.toRotationMatrix();
  rotation_covariance += later.transpose() * step.rotation_covariance * later;
  center_covariance += earlier.transpose() * step.center_covariance * earlier;
}

MeasuredMotion RigPath::MeasuredBetween(int earlier, int later) const {
  const Place& from = *of_frame[earlier];
  const Place& to = *of_frame[later];
  const Matrix3d from_start = from.rig_from_start.rotation.toRotationMatrix();
  const Matrix3d to_start = to.rig_from_start.rotation.toRotationMatrix();
  return {Between(earlier, later),
          to_start * (to.rotation_covariance - from.rotation_covariance) *
              to_start.transpose(),
          from_start * (to.center_covariance - from.center_covariance) *
              from_start.transpose()};
}

bool RigPath::AreSimilar(const Rigid3& a, const Rigid3& b) const {
  return AreEqualMotions({a}, {b}, noise);
}

RigPath FindRigPath(const TemporalOrder& order, int num_frames,
                    const std::vector<std::vector<StepHypotheses>>& hypotheses,
                    const MotionComparison& compare) {
  MGSFM_CHECK_EQ(hypotheses.size(), order.sequences().size());
  RigPath path;
  path.of_frame.resize(num_frames);
  path.is_contested = Mask(num_frames, false);
  path.is_interpolated = Mask(num_frames, false);
  path.num_unknown.resize(num_frames, 0);
  int num_stretches = 0;
  for (size_t s = 0; s < hypotheses.size(); ++s) {
    num_stretches = FollowSequence(order, order.sequences()[s], hypotheses[s],
                                   compare, num_stretches, &path);
  }
  return path;
}

}  // namespace mgsfm

// SPDX-License-Identifier: BSD-3-Clause
#include "moving_objects/motion_search.h"

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <limits>
#include <optional>
#include <vector>

#include "mgsfm/base/error.h"

namespace mgsfm {
namespace {

using Eigen::Vector3d;

// docs/results/constants.md shows the sensitivity to these thresholds.
//
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
constexpr double kInfinity = std::numeric_limits<double>::infinity();

double Loss(double squared) {
  return kLossScale * std::log1p(squared / kLossScale);
}

// Chooses hypotheses by dynamic programming.
class MotionSearch {
 public:
  MotionSearch(const Steps& steps, const Mask& is_doubtful) : steps_(steps) {
    skip_cost_before_.push_back(0.0);
    for (size_t k = 0; k < steps.size(); ++k) {
      const bool may_skip = is_doubtful[k] || steps.candidates[k].empty();
      skip_cost_before_.push_back(skip_cost_before_.back() +
                                  (may_skip ? kSkipCost : kNeverSkip));
    }
  }

  MotionChoice Solve() {
    for (size_t k = 0; k < steps_.size(); ++k) {
      nodes_.emplace_back();
      double lowest = k > 0 ? lowest_before_.back() : kInfinity;
      for (const Candidate& candidate : steps_.candidates[k]) {
        nodes_.back().push_back(BestNode(k, candidate));
        lowest = std::min(lowest,
                          nodes_.back().back().cost - skip_cost_before_[k + 1]);
      }
      lowest_before_.push_back(lowest);
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
           CostOfDistance(candidate, steps_.Duration(k, candidate.num_steps) *
                                         velocity.linear);
  }

  static double OwnCost(const Candidate& candidate) {
    return -kShareWeight * std::log(candidate.share) +
           kNearnessWeight * candidate.nearness +
           (candidate.free_direction ? kFreeDistanceCost : 0.0);
  }

  Node BestNode(size_t k, const Candidate& candidate) const {
    Node best{SkipCost(0, k),
              {},
              VelocityOf(steps_.MotionOf(k, candidate),
                         steps_.Duration(k, candidate.num_steps))};
    for (size_t end = k + 1 - candidate.num_steps; end > 0; --end) {
      const size_t previous = end - 1;
      if (lowest_before_[previous] + skip_cost_before_[k] >= best.cost) break;
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
      for (size_t i = 1; i < chosen[k]->candidate.num_steps; ++i) {
        chosen[k - i] = chosen[k];
        chosen[k - i]->is_inside = true;
      }
      position = nodes_[k][h].previous;
    }
    return chosen;
  }

  // The costs of the steps from one on.
  struct LaterCosts {
    std::vector<std::vector<double>> of_node;  // if they begin with a node
    // Per step: the lowest one, if they begin with a node of this step or of a
    // later one, and all steps before it are skipped.
    std::vector<double> lowest;
  };

  // The lowest cost of all steps after a node of step k.
  double CostAfter(size_t k, const Node& node, const LaterCosts& later) const {
    double lowest = SkipCost(k + 1, nodes_.size());
    for (size_t next = k + 1; next < nodes_.size(); ++next) {
      if (later.lowest[next] - skip_cost_before_[k + 1] >= lowest) break;
      for (size_t g = 0; g < nodes_[next].size(); ++g) {
        const Candidate& candidate = steps_.candidates[next][g];
        if (k + candidate.num_steps > next) continue;
        const double cost = SkipCost(k + 1, next) + later.of_node[next][g];
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
    LaterCosts later;
    later.of_node.resize(nodes_.size());
    later.lowest.resize(nodes_.size() + 1, kInfinity);
    std::vector<double> margins(nodes_.size(), kInfinity);
    for (size_t k = nodes_.size(); k-- > 0;) {
      const auto& chosen = choice.motions[k];
      later.lowest[k] = later.lowest[k + 1];
      for (size_t h = 0; h < nodes_[k].size(); ++h) {
        const Node& node = nodes_[k][h];
        const double after = CostAfter(k, node, later);
        later.of_node[k].push_back(OwnCost(steps_.candidates[k][h]) + after);
        later.lowest[k] = std::min(
            later.lowest[k], skip_cost_before_[k] + later.of_node[k].back());
        const double margin = node.cost + after - choice.cost;
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
    const MeasuredMotion motion = mgsfm::MotionOf(
        chosen.velocity, steps_.Duration(k, candidate.num_steps));
    if (!AreEqualMotions(
            candidate.ClosestTo(motion.later_from_earlier.Center()), motion,
            steps_.noise, kDistinct)) {
      return true;
    }
    return chosen.HasDistance() &&
           (!steps_.compare || candidate.num_steps > 1 ||
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
  std::vector<std::vector<Node>> nodes_;
  // Per step: the lowest cost of a node of this step or of an earlier one, less
  // that of skipping all steps up to the node.
  std::vector<double> lowest_before_;
};

}  // namespace

MotionChoice ChooseMotions(const Steps& steps, const Mask& is_doubtful) {
  MGSFM_CHECK_EQ(is_doubtful.size(), steps.size());
  return MotionSearch(steps, is_doubtful).Solve();
}

}  // namespace mgsfm

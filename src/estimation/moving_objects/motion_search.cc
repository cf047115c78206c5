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

// The thresholds of this file at half and twice their values are compared in
// docs/results/constants.md.
//
// A step without a hypothesis counts like one that 2 % of the matches support.
constexpr double kSkipCost = 4.0;
// Weight of the share of matches: a vehicle has four times as many as the
// static scene for tens of frames. With 1, a path followed one for 38 steps.
constexpr double kShareWeight = 0.5;
// Weight of the logarithm of the relative reach. On eight drives, 38 steps are
// unknown with 1 and 12 with 2 or 3, and 20 are wrong with each
// (docs/results/constants.md).
constexpr double kNearnessWeight = 2.0;
// A step without a distance fits any speed, so that one with a distance that
// continues the motion must be preferred.
constexpr double kFreeDistanceCost = 1.0;
// Cost above that of any jump that a skip could avoid.
constexpr double kNeverSkip = 1e4;
// Scale of the loss of the squared change of the motion. Half or twice the
// value changes no error (docs/results/constants.md).
constexpr double kLossScale = 30.0;
// Motions are different beyond this many tolerances. With 1.5 and 3, 79 and 50
// instead of 64 % of the wrong steps of 200 drives had a margin below 3, and
// 1.9 and 1.0 instead of 1.3 % of the right ones (docs/results/constants.md).
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
      skip_cost_before_.push_back(skip_cost_before_.back() +
                                  (is_doubtful[k] || steps.candidates[k].empty()
                                       ? kSkipCost
                                       : kNeverSkip));
    }
  }

  MotionChoice Solve() {
    for (size_t k = 0; k < steps_.size(); ++k) {
      nodes_.emplace_back();
      for (size_t h = 0; h < steps_.candidates[k].size(); ++h) {
        nodes_.back().push_back(BestNode(k, h));
      }
    }
    MotionChoice choice;
    choice.motions = TraceBack(&choice.cost);
    choice.margins = Margins(choice.motions, choice.cost);
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

  // The cost of a free distance that differs from those by matches with depth.
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

  Node BestNode(size_t k, size_t h) const {
    const Candidate& hypothesis = steps_.candidates[k][h];
    Node best = AfterGap(k);
    best.velocity = VelocityOf(
        hypothesis.MotionAfter(ForwardStep(
            hypothesis, steps_.durations[k] * steps_.noise.median_step)),
        steps_.durations[k]);
    const size_t first = k > kMaxNumSkipped ? k - 1 - kMaxNumSkipped : 0;
    for (size_t previous = first; previous < k; ++previous) {
      for (size_t g = 0; g < steps_.candidates[previous].size(); ++g) {
        const Node& node = nodes_[previous][g];
        if (node.cost + SkipCost(previous + 1, k) >= best.cost) continue;
        const Velocity velocity =
            steps_.VelocityAfter(node.velocity.linear, k, hypothesis);
        const double cost = node.cost + SkipCost(previous + 1, k) +
                            CostOfChange(node, velocity, k, hypothesis);
        if (cost >= best.cost) continue;
        best = {cost, Position{previous, g}, velocity};
      }
    }
    best.cost += OwnCost(hypothesis);
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

  std::vector<std::optional<ChosenMotion>> TraceBack(double* lowest) const {
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
    std::vector<std::optional<ChosenMotion>> chosen(steps_.size());
    while (position) {
      const auto [k, h] = *position;
      chosen[k] = ChosenMotion{nodes_[k][h].velocity, steps_.candidates[k][h]};
      position = nodes_[k][h].previous;
    }
    return chosen;
  }

  // The lowest cost of all steps after node h of step k, given those of the
  // nodes of later steps.
  double CostAfter(size_t k, size_t h,
                   const std::vector<std::vector<double>>& after) const {
    const Node& node = nodes_[k][h];
    double lowest = SkipCost(k + 1, nodes_.size());
    bool are_empty = true;  // the steps between
    for (size_t next = k + 1; next < nodes_.size(); ++next) {
      are_empty = are_empty && (next == k + 1 || nodes_[next - 1].empty());
      const bool is_gap = next - k - 1 > kMaxNumSkipped;
      if (is_gap && !are_empty) break;
      for (size_t g = 0; g < nodes_[next].size(); ++g) {
        const Candidate& candidate = steps_.candidates[next][g];
        double cost =
            SkipCost(k + 1, next) + OwnCost(candidate) + after[next][g];
        if (cost >= lowest) continue;
        if (!is_gap) {
          const Velocity velocity =
              steps_.VelocityAfter(node.velocity.linear, next, candidate);
          cost += CostOfChange(node, velocity, next, candidate);
        }
        lowest = std::min(lowest, cost);
      }
    }
    return lowest;
  }

  std::vector<double> Margins(
      const std::vector<std::optional<ChosenMotion>>& chosen,
      double lowest) const {
    std::vector<std::vector<double>> after(nodes_.size());
    for (size_t k = nodes_.size(); k-- > 0;) {
      for (size_t h = 0; h < nodes_[k].size(); ++h) {
        after[k].push_back(CostAfter(k, h, after));
      }
    }
    std::vector<double> margins(nodes_.size(), kInfinity);
    for (size_t k = 0; k < nodes_.size(); ++k) {
      for (size_t h = 0; h < nodes_[k].size(); ++h) {
        const Node& node = nodes_[k][h];
        if (chosen[k] && AreSimilar(chosen[k]->velocity, node.velocity)) {
          continue;
        }
        margins[k] = std::min(margins[k], node.cost + after[k][h] - lowest);
      }
    }
    return margins;
  }

  bool AreSimilar(const Velocity& a, const Velocity& b) const {
    return AreEqualMotions(MotionOf(a, 1.0), MotionOf(b, 1.0), steps_.noise,
                           kDistinct);
  }

  const Steps& steps_;
  std::vector<double> skip_cost_before_;  // sums over the steps before each
  std::vector<std::vector<Node>> nodes_;
};

}  // namespace

MotionChoice ChooseMotions(const Steps& steps, const Mask& is_doubtful) {
  MGSFM_CHECK_EQ(is_doubtful.size(), steps.size());
  return MotionSearch(steps, is_doubtful).Solve();
}

}  // namespace mgsfm

// SPDX-License-Identifier: BSD-3-Clause
#include "pair_filtering/motion_continuity.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>
#include <limits>
#include <map>
#include <optional>
#include <utility>
#include <vector>

#include "math/statistics.h"
#include "mgsfm/base/error.h"

namespace mgsfm {
namespace {

using Eigen::Vector3d;
using FramePair = FramePairIndex::FramePair;

// Of the larger speed, per step: a car that brakes hard from 14 m/s loses 0.1
// of its speed in 0.3 s.
constexpr double kRelativeChange = 0.1;
// Of the median speed, per step: allows a stop at walking pace.
constexpr double kMinChange = 0.03;
// A step without a hypothesis counts like one that 2 % of the matches support.
constexpr double kSkipCost = 4.0;
constexpr size_t kMaxNumSkipped = 7;
// More than any jumps that skipping a step could avoid.
constexpr double kNeverSkip = 1e4;
// Hypotheses of a step disagree if one has a smaller share than this.
constexpr double kMaxContestedShare = 0.9;
constexpr double kJumpCost = 100.0;
// Hypotheses agree within this share of the longer one, or of the median.
constexpr double kRelativeTolerance = 0.2;
constexpr double kMinTolerance = 0.04;
// A contradiction is at least this share of the median step; less is noise at
// standstill.
constexpr double kMinContradiction = 0.2;
// Baselines from which the offset between two sensors is estimated.
constexpr size_t kMinNumOffsets = 5;

struct Hypothesis {
  Vector3d step_in_world = Vector3d::Zero();
  double num_matches = 0.0;
  double share = 0.0;  // of the matches of the step that agree
};
using Hypotheses = std::vector<Hypothesis>;  // of one step

bool Agree(const Vector3d& a, const Vector3d& b, double unit) {
  return (a - b).norm() <= kRelativeTolerance * std::max(a.norm(), b.norm()) +
                               kMinTolerance * unit;
}

// The baselines of the pairs, from the earlier to the later frame.
class Displacements {
 public:
  Displacements(const Scene& scene, const ViewGraph& view_graph,
                const SupportedBaselines& baselines)
      : scene_(scene), view_graph_(view_graph), baselines_(baselines) {}

  std::array<int, 2> SensorsFrom(int frame_idx, size_t pair_idx) const {
    const ImagePair& pair = view_graph_.pairs[pair_idx];
    std::array<int, 2> sensors{scene_.images[pair.image_idx1].sensor_idx,
                               scene_.images[pair.image_idx2].sensor_idx};
    if (!BeginsAt(frame_idx, pair_idx)) std::swap(sensors[0], sensors[1]);
    return sensors;
  }
  std::vector<SupportedBaseline> From(int frame_idx, size_t pair_idx) const {
    std::vector<SupportedBaseline> baselines = baselines_[pair_idx];
    if (BeginsAt(frame_idx, pair_idx)) return baselines;
    for (SupportedBaseline& b : baselines) b.baseline_in_world *= -1.0;
    return baselines;
  }

 private:
  bool BeginsAt(int frame_idx, size_t pair_idx) const {
    const int image_idx1 = view_graph_.pairs[pair_idx].image_idx1;
    return scene_.images[image_idx1].frame_idx == frame_idx;
  }

  const Scene& scene_;
  const ViewGraph& view_graph_;
  const SupportedBaselines& baselines_;
};

// Per step of the sequence.
std::vector<Hypotheses> FindHypotheses(const std::vector<int>& sequence,
                                       const FramePairIndex& index,
                                       const Displacements& displacements) {
  std::vector<Hypotheses> steps(sequence.size() - 1);
  for (size_t k = 0; k < steps.size(); ++k) {
    const FramePair* frames = index.Find(sequence[k], sequence[k + 1]);
    if (frames == nullptr) continue;
    for (const size_t i : frames->pair_idxs) {
      const auto [sensor1, sensor2] = displacements.SensorsFrom(sequence[k], i);
      if (sensor1 != sensor2) continue;
      for (const auto& b : displacements.From(sequence[k], i)) {
        steps[k].push_back({b.baseline_in_world, b.num_matches});
      }
    }
  }
  return steps;
}

double MedianLength(const std::vector<Hypotheses>& steps) {
  std::vector<double> lengths;
  for (const Hypotheses& step : steps) {
    for (const Hypothesis& h : step) lengths.push_back(h.step_in_world.norm());
  }
  return lengths.empty() ? 0.0 : Median(std::move(lengths));
}

void ComputeShares(double unit, Hypotheses* step) {
  double num_matches = 0.0;
  for (const Hypothesis& h : *step) num_matches += h.num_matches;
  for (Hypothesis& h : *step) {
    double num_agreeing = 0.0;
    for (const Hypothesis& other : *step) {
      if (Agree(h.step_in_world, other.step_in_world, unit)) {
        num_agreeing += other.num_matches;
      }
    }
    h.share = num_agreeing / num_matches;
  }
}

// Per step: whether a step may remain without a hypothesis, as one within reach
// has hypotheses that disagree. Elsewhere nothing questions them.
Mask FindSkippable(const std::vector<Hypotheses>& steps) {
  Mask is_skippable(steps.size(), false);
  for (size_t k = 0; k < steps.size(); ++k) {
    const bool is_contested = std::any_of(
        steps[k].begin(), steps[k].end(),
        [](const Hypothesis& h) { return h.share < kMaxContestedShare; });
    if (!is_contested && !steps[k].empty()) continue;
    const size_t begin = k > kMaxNumSkipped ? k - kMaxNumSkipped : 0;
    const size_t end = std::min(steps.size(), k + kMaxNumSkipped + 1);
    if (is_contested) is_skippable.Fill(begin, end, true);
    is_skippable[k] = true;
  }
  return is_skippable;
}

// Chooses hypotheses by dynamic programming.
class MotionSearch {
 public:
  // `durations` are those of the steps; `unit` is the median step.
  MotionSearch(const std::vector<Hypotheses>& steps,
               const std::vector<double>& durations, double unit)
      : steps_(steps), durations_(durations), unit_(unit) {
    const Mask is_skippable = FindSkippable(steps);
    skip_cost_before_.push_back(0.0);
    for (size_t k = 0; k < steps.size(); ++k) {
      skip_cost_before_.push_back(skip_cost_before_.back() +
                                  (is_skippable[k] ? kSkipCost : kNeverSkip));
    }
  }

  // Per step: the chosen hypothesis, if any.
  std::vector<std::optional<size_t>> Solve() {
    for (size_t k = 0; k < steps_.size(); ++k) {
      nodes_.emplace_back();
      for (size_t h = 0; h < steps_[k].size(); ++h) {
        nodes_.back().push_back(BestNode(k, h));
      }
    }
    return TraceBack();
  }

 private:
  struct Place {
    size_t step, hypothesis;
  };
  struct Node {
    double cost = 0.0;
    std::optional<Place> previous;
  };

  // Of the steps in [begin, end).
  double SkipCost(size_t begin, size_t end) const {
    return skip_cost_before_[end] - skip_cost_before_[begin];
  }

  Vector3d Speed(size_t k, size_t h) const {
    return steps_[k][h].step_in_world / durations_[k];
  }

  double CostOfChange(size_t k1, size_t h1, size_t k2, size_t h2) const {
    const Vector3d speed1 = Speed(k1, h1), speed2 = Speed(k2, h2);
    const double scale =
        kRelativeChange * std::max(speed1.norm(), speed2.norm()) +
        kMinChange * unit_;
    return std::min((speed1 - speed2).squaredNorm() / (scale * scale),
                    kJumpCost);
  }

  Node BestNode(size_t k, size_t h) const {
    Node best{SkipCost(0, k), std::nullopt};
    const size_t first = k > kMaxNumSkipped ? k - 1 - kMaxNumSkipped : 0;
    for (size_t previous = first; previous < k; ++previous) {
      for (size_t g = 0; g < steps_[previous].size(); ++g) {
        const double cost = nodes_[previous][g].cost +
                            CostOfChange(previous, g, k, h) +
                            SkipCost(previous + 1, k);
        if (cost < best.cost) best = {cost, Place{previous, g}};
      }
    }
    best.cost -= std::log(steps_[k][h].share);
    return best;
  }

  std::vector<std::optional<size_t>> TraceBack() const {
    std::optional<Place> place;
    double lowest = 0.0;
    for (size_t k = 0; k < nodes_.size(); ++k) {
      for (size_t h = 0; h < nodes_[k].size(); ++h) {
        const double cost = nodes_[k][h].cost + SkipCost(k + 1, nodes_.size());
        if (!place || cost < lowest) {
          lowest = cost;
          place = Place{k, h};
        }
      }
    }
    std::vector<std::optional<size_t>> chosen(steps_.size());
    while (place) {
      chosen[place->step] = place->hypothesis;
      place = nodes_[place->step][place->hypothesis].previous;
    }
    return chosen;
  }

  const std::vector<Hypotheses>& steps_;
  const std::vector<double>& durations_;
  const double unit_;
  std::vector<double> skip_cost_before_;  // sums over the steps before each
  std::vector<std::vector<Node>> nodes_;
};

// Where a frame is along the chosen motion. Frames of different stretches are
// not comparable.
struct MotionAt {
  int stretch = 0;
  Vector3d center = Vector3d::Zero();
};

// Steps without a choice have the mean speed of their neighbours; a longer gap
// begins another stretch.
std::vector<MotionAt> FollowMotion(
    const std::vector<Hypotheses>& steps, const std::vector<double>& durations,
    const std::vector<std::optional<size_t>>& chosen) {
  std::vector<MotionAt> motion(steps.size() + 1);
  std::optional<size_t> previous;
  const auto speed_of = [&](size_t k) {
    return Vector3d(steps[k][*chosen[k]].step_in_world / durations[k]);
  };
  for (size_t k = 0; k < steps.size(); ++k) {
    MotionAt next = motion[k];
    size_t following = k;
    while (following < steps.size() && !chosen[following]) ++following;
    const bool is_at_end = following == steps.size();
    if (chosen[k]) {
      next.center += steps[k][*chosen[k]].step_in_world;
      previous = k;
    } else if (is_at_end || !previous ||
               following - *previous - 1 > kMaxNumSkipped) {
      ++next.stretch;
    } else {
      next.center +=
          durations[k] * 0.5 * (speed_of(*previous) + speed_of(following));
    }
    motion[k + 1] = next;
  }
  return motion;
}

// The chosen motion at each frame of one sequence.
std::vector<MotionAt> EstimateMotion(const TemporalOrder& order,
                                     const std::vector<int>& sequence,
                                     std::vector<Hypotheses> steps) {
  const double unit = MedianLength(steps);
  std::vector<double> durations;
  for (size_t k = 0; k < steps.size(); ++k) {
    durations.push_back(order.Duration(sequence[k], sequence[k + 1]));
    ComputeShares(unit, &steps[k]);
  }
  return FollowMotion(steps, durations,
                      MotionSearch(steps, durations, unit).Solve());
}

// Offsets between the cameras of two sensors, in the frame of the rig.
class SensorOffsets {
 public:
  void Add(const std::array<int, 2>& sensors, const Vector3d& offset_in_rig) {
    const bool is_ordered = sensors[0] < sensors[1];
    samples_[std::minmax(sensors[0], sensors[1])].push_back(
        is_ordered ? offset_in_rig : Vector3d(-offset_in_rig));
  }
  void ComputeMedians() {
    for (const auto& [sensors, samples] : samples_) {
      if (samples.size() < kMinNumOffsets) continue;
      Vector3d median;
      for (int axis = 0; axis < 3; ++axis) {
        std::vector<double> values;
        for (const Vector3d& sample : samples) values.push_back(sample[axis]);
        median[axis] = Median(std::move(values));
      }
      medians_[sensors] = median;
    }
  }
  std::optional<Vector3d> Of(const std::array<int, 2>& sensors) const {
    if (sensors[0] == sensors[1]) return Vector3d(Vector3d::Zero());
    const auto found = medians_.find(std::minmax(sensors[0], sensors[1]));
    if (found == medians_.end()) return std::nullopt;
    return sensors[0] < sensors[1] ? found->second : Vector3d(-found->second);
  }

 private:
  std::map<std::pair<int, int>, std::vector<Vector3d>> samples_;
  std::map<std::pair<int, int>, Vector3d> medians_;
};

// The chosen motion of all sequences.
struct Motion {
  std::vector<std::optional<MotionAt>> at_frame;
  double unit = 0.0;  // the longest median step of a sequence

  bool IsComparable(int frame_idx1, int frame_idx2) const {
    const auto& at1 = at_frame[frame_idx1];
    const auto& at2 = at_frame[frame_idx2];
    return at1 && at2 && at1->stretch == at2->stretch;
  }
  Vector3d Between(int first, int last) const {
    return at_frame[last]->center - at_frame[first]->center;
  }
};

Motion FollowSequences(const Scene& scene, const FramePairIndex& index,
                       const Displacements& displacements) {
  Motion motion;
  motion.at_frame.resize(scene.frames.size());
  for (const std::vector<int>& sequence : index.order()->sequences()) {
    if (sequence.size() < 2) continue;
    const std::vector<Hypotheses> steps =
        FindHypotheses(sequence, index, displacements);
    motion.unit = std::max(motion.unit, MedianLength(steps));
    const std::vector<MotionAt> at_rank =
        EstimateMotion(*index.order(), sequence, steps);
    for (size_t k = 0; k < sequence.size(); ++k) {
      motion.at_frame[sequence[k]] = at_rank[k];
    }
  }
  return motion;
}

// A pair between neighbours, or within a frame, on one stretch of the motion.
struct JudgedPair {
  size_t pair_idx;
  int first_frame_idx, last_frame_idx;
  Eigen::Quaterniond rig_from_world;  // of the first frame
  std::array<int, 2> sensors;
  std::vector<SupportedBaseline> baselines;  // from the first frame
};

std::vector<JudgedPair> CollectPairs(const FramePairIndex& index,
                                     const RotationEstimate& rotations,
                                     const Displacements& displacements,
                                     const Motion& motion) {
  std::vector<JudgedPair> pairs;
  for (const FramePair& frames : index.frame_pairs()) {
    if (!frames.time_gap || *frames.time_gap > kMaxSequentialGap) continue;
    int first = frames.frame_idx1, last = frames.frame_idx2;
    if (index.order()->IsBefore(last, first)) std::swap(first, last);
    const auto& rig_from_world = rotations.rig_from_world[first];
    if (!rig_from_world || !motion.IsComparable(first, last)) continue;
    for (const size_t i : frames.pair_idxs) {
      std::vector<SupportedBaseline> baselines = displacements.From(first, i);
      if (baselines.empty()) continue;
      pairs.push_back({i, first, last, *rig_from_world,
                       displacements.SensorsFrom(first, i),
                       std::move(baselines)});
    }
  }
  return pairs;
}

SensorOffsets EstimateOffsets(const std::vector<JudgedPair>& pairs,
                              const Motion& motion) {
  SensorOffsets offsets;
  for (const JudgedPair& pair : pairs) {
    if (pair.sensors[0] == pair.sensors[1]) continue;
    const Vector3d moved =
        motion.Between(pair.first_frame_idx, pair.last_frame_idx);
    for (const SupportedBaseline& b : pair.baselines) {
      offsets.Add(pair.sensors,
                  pair.rig_from_world * (b.baseline_in_world - moved));
    }
  }
  offsets.ComputeMedians();
  return offsets;
}

// The baseline of the pair nearest to the expected one, if any is near enough.
std::optional<size_t> FindAgreeing(const JudgedPair& pair,
                                   const Vector3d& expected, double unit,
                                   double max_relative_error) {
  std::optional<size_t> nearest;
  double smallest_error = std::numeric_limits<double>::infinity();
  for (size_t i = 0; i < pair.baselines.size(); ++i) {
    const Vector3d& baseline = pair.baselines[i].baseline_in_world;
    const double error = (baseline - expected).norm();
    const double tolerance = std::max(
        max_relative_error * std::max(baseline.norm(), expected.norm()),
        kMinContradiction * unit);
    if (error > tolerance || error >= smallest_error) continue;
    smallest_error = error;
    nearest = i;
  }
  return nearest;
}

}  // namespace

MotionConsistency CheckMotion(const Scene& scene, const FramePairIndex& index,
                              const ViewGraph& view_graph,
                              const RotationEstimate& rotations,
                              const SupportedBaselines& baselines,
                              const PairFilteringOptions& options) {
  MGSFM_CHECK_EQ(baselines.size(), view_graph.pairs.size());
  MotionConsistency result{Mask(baselines.size(), false), {}};
  result.agreeing.resize(baselines.size());
  if (!index.is_sequence()) return result;
  const Displacements displacements(scene, view_graph, baselines);
  const Motion motion = FollowSequences(scene, index, displacements);
  const std::vector<JudgedPair> pairs =
      CollectPairs(index, rotations, displacements, motion);
  const SensorOffsets offsets = EstimateOffsets(pairs, motion);
  for (const JudgedPair& pair : pairs) {
    const int first = pair.first_frame_idx, last = pair.last_frame_idx;
    const auto offset = offsets.Of(pair.sensors);
    if (first == last || !offset) continue;
    const Vector3d expected =
        motion.Between(first, last) + pair.rig_from_world.conjugate() * *offset;
    auto& agreeing = result.agreeing[pair.pair_idx];
    agreeing = FindAgreeing(pair, expected, motion.unit,
                            options.max_relative_baseline_error);
    result.pair_is_discontinuous[pair.pair_idx] = !agreeing;
  }
  return result;
}

}  // namespace mgsfm

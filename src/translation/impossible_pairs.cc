// SPDX-License-Identifier: BSD-3-Clause
#include "translation/impossible_pairs.h"

#include <algorithm>
#include <cstddef>

#include "mgsfm/math/graph.h"
#include "mgsfm/math/spanning_tree.h"
#include "mgsfm/scene/backbone.h"
#include "translation/pair_consistency.h"

namespace mgsfm {
namespace {

constexpr double kMaxErrorInDepths = 0.25;

// Frames of a pair with a direction; equal for all others.
struct FramePair {
  int frame_idx1 = 0;
  int frame_idx2 = 0;
  bool IsBetweenFrames() const { return frame_idx1 != frame_idx2; }
};

std::vector<FramePair> FramesOfPairs(const PositionProblem& problem,
                                     const std::vector<PairMotion>& motions) {
  std::vector<FramePair> pairs(motions.size());
  for (size_t i = 0; i < motions.size(); ++i) {
    if (motions[i].kind != MotionKind::kDirection) continue;
    pairs[i] = {problem.frame_idx[motions[i].image_idx1],
                problem.frame_idx[motions[i].image_idx2]};
  }
  return pairs;
}

}  // namespace

std::vector<char> FindImpossiblePairs(const PositionProblem& problem,
                                      const std::vector<PairMotion>& motions,
                                      const std::vector<int>& num_matches,
                                      const std::vector<char>& is_in_backbone,
                                      const PairScales& scales,
                                      const InitialPositions& by_backbone,
                                      double max_drift) {
  const std::vector<FramePair> pairs = FramesOfPairs(problem, motions);
  const Positions& positions = by_backbone.positions;
  const double unit =
      by_backbone.group_factor.empty() ? 1.0 : by_backbone.group_factor.front();
  std::vector<GraphEdge> edges;
  std::vector<double> lengths;
  for (size_t i = 0; i < motions.size(); ++i) {
    if (!is_in_backbone[i] || !pairs[i].IsBetweenFrames()) continue;
    edges.push_back({pairs[i].frame_idx1, pairs[i].frame_idx2,
                     static_cast<double>(num_matches[i])});
    lengths.push_back(scales.scale[i] * unit);
  }
  const ForestWays ways(problem.num_frames, edges, lengths);
  std::vector<char> is_impossible(motions.size(), false);
  int num_tested = 0, num_impossible = 0;
  for (size_t i = 0; i < motions.size(); ++i) {
    if (scales.group[i] != 0 || !pairs[i].IsBetweenFrames() ||
        !positions.IsPlaced(problem, motions[i].image_idx1) ||
        !positions.IsPlaced(problem, motions[i].image_idx2)) {
      continue;
    }
    const Eigen::Vector3d error =
        positions.CamCenter(problem, motions[i].image_idx2) -
        positions.CamCenter(problem, motions[i].image_idx1) -
        scales.scale[i] * unit * motions[i].direction;
    is_impossible[i] =
        error.norm() >
        max_drift * ways.Between(pairs[i].frame_idx1, pairs[i].frame_idx2) +
            kMaxErrorInDepths * scales.typical_depth * unit;
    ++num_tested;
    num_impossible += is_impossible[i];
  }
  if (num_impossible > kMaxShareBeyondDrift * num_tested) {
    is_impossible.assign(motions.size(), false);
  }
  return is_impossible;
}

int CountTornPairs(const PositionProblem& problem,
                   const std::vector<PairMotion>& motions,
                   const std::vector<char>& is_in_backbone,
                   const PairScales& scales,
                   const InitialPositions& by_backbone,
                   const InitialPositions& initial) {
  const auto contradicting = [&](const InitialPositions& by) {
    return FindContradictingPairs(problem, motions, scales, by, by.positions);
  };
  const std::vector<char> contradicts_backbone = contradicting(by_backbone);
  const std::vector<char> contradicts = contradicting(initial);
  const auto are_placed = [&](const Positions& positions, size_t i) {
    return positions.IsPlaced(problem, motions[i].image_idx1) &&
           positions.IsPlaced(problem, motions[i].image_idx2);
  };
  int num_torn = 0;
  for (size_t i = 0; i < motions.size(); ++i) {
    num_torn += is_in_backbone[i] && !contradicts_backbone[i] &&
                (contradicts[i] || (are_placed(by_backbone.positions, i) &&
                                    !are_placed(initial.positions, i)));
  }
  return num_torn;
}

}  // namespace mgsfm

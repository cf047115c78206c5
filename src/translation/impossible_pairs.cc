// SPDX-License-Identifier: BSD-3-Clause
#include "translation/impossible_pairs.h"

#include <algorithm>
#include <cstddef>

#include "math/graph.h"
#include "math/spanning_tree.h"
#include "mgsfm/base/mask.h"
#include "mgsfm/pair_filtering/skeletal_graph.h"
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

std::vector<FramePair> FramesOfPairs(
    const PositionProblem& problem,
    const std::vector<BaselineDirection>& motions) {
  std::vector<FramePair> pairs(motions.size());
  for (size_t i = 0; i < motions.size(); ++i) {
    if (motions[i].kind != BaselineKind::kDirection) continue;
    pairs[i] = {problem.frame_idx[motions[i].image_idx1],
                problem.frame_idx[motions[i].image_idx2]};
  }
  return pairs;
}

}  // namespace

Mask FindInconsistentBaselines(const PositionProblem& problem,
                               const std::vector<BaselineDirection>& motions,
                               const std::vector<int>& num_matches,
                               const Mask& is_in_skeleton,
                               const PairScales& scales,
                               const InitialPositions& by_skeleton,
                               double max_drift) {
  const std::vector<FramePair> pairs = FramesOfPairs(problem, motions);
  const Positions& positions = by_skeleton.positions;
  const double unit =
      by_skeleton.group_factor.empty() ? 1.0 : by_skeleton.group_factor.front();
  std::vector<GraphEdge> edges;
  std::vector<double> lengths;
  for (size_t i = 0; i < motions.size(); ++i) {
    if (!is_in_skeleton[i] || !pairs[i].IsBetweenFrames()) continue;
    edges.push_back({pairs[i].frame_idx1, pairs[i].frame_idx2,
                     static_cast<double>(num_matches[i])});
    lengths.push_back(scales.scale[i] * unit);
  }
  const TreePathLengths ways(problem.num_frames, edges, lengths);
  Mask is_inconsistent(motions.size(), false);
  int num_tested = 0, num_inconsistent = 0;
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
    is_inconsistent[i] =
        error.norm() >
        max_drift * ways.Between(pairs[i].frame_idx1, pairs[i].frame_idx2) +
            kMaxErrorInDepths * scales.typical_depth * unit;
    ++num_tested;
    num_inconsistent += is_inconsistent[i];
  }
  if (num_inconsistent > kMaxShareBeyondDrift * num_tested) {
    is_inconsistent.assign(motions.size(), false);
  }
  return is_inconsistent;
}

int CountViolatedSkeletonEdges(const PositionProblem& problem,
                               const std::vector<BaselineDirection>& motions,
                               const Mask& is_in_skeleton,
                               const PairScales& scales,
                               const InitialPositions& by_skeleton,
                               const InitialPositions& initial) {
  const auto contradicting = [&](const InitialPositions& by) {
    return FindInconsistentPairs(problem, motions, scales, by, by.positions);
  };
  const Mask is_inconsistent_with_skeleton = contradicting(by_skeleton);
  const Mask contradicts = contradicting(initial);
  const auto are_placed = [&](const Positions& positions, size_t i) {
    return positions.IsPlaced(problem, motions[i].image_idx1) &&
           positions.IsPlaced(problem, motions[i].image_idx2);
  };
  int num_violated = 0;
  for (size_t i = 0; i < motions.size(); ++i) {
    num_violated += is_in_skeleton[i] && !is_inconsistent_with_skeleton[i] &&
                    (contradicts[i] || (are_placed(by_skeleton.positions, i) &&
                                        !are_placed(initial.positions, i)));
  }
  return num_violated;
}

}  // namespace mgsfm

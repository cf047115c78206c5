// SPDX-License-Identifier: BSD-3-Clause
#include "translation/pair_consistency.h"

#include <algorithm>
#include <cstddef>

#include "mgsfm/math/graph.h"

namespace mgsfm {
namespace {

constexpr double kMinRelativeError = 0.5;
constexpr double kMinErrorInDepths = 0.25;

}  // namespace

std::vector<char> FindContradictingPairs(const PositionProblem& problem,
                                         const std::vector<PairMotion>& motions,
                                         const PairScales& scales,
                                         const InitialPositions& initial,
                                         const Positions& positions) {
  std::vector<char> contradicts(motions.size(), false);
  for (size_t i = 0; i < motions.size(); ++i) {
    const PairMotion& motion = motions[i];
    if (scales.group[i] < 0 ||
        !positions.IsPlaced(problem, motion.image_idx1) ||
        !positions.IsPlaced(problem, motion.image_idx2)) {
      continue;
    }
    const double unit = initial.group_factor[scales.group[i]];
    const double length = scales.scale[i] * unit;
    const Eigen::Vector3d baseline =
        positions.CamCenter(problem, motion.image_idx2) -
        positions.CamCenter(problem, motion.image_idx1);
    const double error = (baseline - length * motion.direction).norm();
    contradicts[i] =
        error > kMinRelativeError * std::max(length, baseline.norm()) &&
        error > kMinErrorInDepths * scales.typical_depth * unit;
  }
  return contradicts;
}

std::vector<SuspiciousGroup> GroupSuspiciousPairs(
    const PositionProblem& problem, const std::vector<PairMotion>& motions,
    const std::vector<char>& pair_contradicts) {
  std::vector<GraphEdge> edges;
  for (size_t i = 0; i < motions.size(); ++i) {
    if (!pair_contradicts[i]) continue;
    const auto [low, high] =
        std::minmax({problem.frame_idx[motions[i].image_idx1],
                     problem.frame_idx[motions[i].image_idx2]});
    edges.push_back({low, high});
  }
  const ConnectedParts parts = FindConnectedParts(problem.num_frames, edges);
  std::vector<SuspiciousGroup> group_of_part(parts.num_parts);
  for (const GraphEdge& edge : edges) {
    SuspiciousGroup& group = group_of_part[parts.part[edge.node1]];
    if (group.num_pairs == 0) {
      group = {0, edge.node1, edge.node1, edge.node2, edge.node2};
    }
    ++group.num_pairs;
    group.first_frame_idx1 = std::min(group.first_frame_idx1, edge.node1);
    group.last_frame_idx1 = std::max(group.last_frame_idx1, edge.node1);
    group.first_frame_idx2 = std::min(group.first_frame_idx2, edge.node2);
    group.last_frame_idx2 = std::max(group.last_frame_idx2, edge.node2);
  }
  std::vector<SuspiciousGroup> groups;
  for (const SuspiciousGroup& group : group_of_part) {
    if (group.num_pairs > 0) groups.push_back(group);
  }
  std::stable_sort(groups.begin(), groups.end(),
                   [](const SuspiciousGroup& a, const SuspiciousGroup& b) {
                     return a.num_pairs > b.num_pairs;
                   });
  return groups;
}

}  // namespace mgsfm

// SPDX-License-Identifier: BSD-3-Clause
#include "pair_filtering/drift_bound.h"

#include <algorithm>
#include <cmath>
#include <vector>

namespace mgsfm {
namespace {

// Half is the breakdown point of a majority vote; a third keeps a margin.
constexpr double kMaxRejectedShare = 1.0 / 3.0;

TreePathLengths PathsThroughSkeleton(
    const FramePairIndex& index, const ViewGraph& view_graph,
    const Mask& is_in_skeleton,
    const std::function<double(size_t)>& length_of_pair) {
  std::vector<GraphEdge> edges;
  std::vector<double> lengths;
  for (size_t i = 0; i < is_in_skeleton.size(); ++i) {
    const FramePairIndex::FramePair& frames = index.Of(i);
    if (!is_in_skeleton[i] || !frames.IsBetweenFrames()) continue;
    edges.push_back({frames.frame_idx1, frames.frame_idx2,
                     static_cast<double>(view_graph.pairs[i].matches.size())});
    lengths.push_back(length_of_pair(i));
  }
  return {index.num_frames(), edges, lengths};
}

}  // namespace

DriftBound::DriftBound(const FramePairIndex& index, const ViewGraph& view_graph,
                       const Mask& is_in_skeleton,
                       const std::function<double(size_t)>& length_of_pair,
                       const Model& model)
    : paths_(PathsThroughSkeleton(index, view_graph, is_in_skeleton,
                                  length_of_pair)),
      model_(model) {}

double DriftBound::Of(const FramePairIndex::FramePair& frames) const {
  const double length = paths_.Between(frames.frame_idx1, frames.frame_idx2);
  const double growth =
      model_.growth == DriftGrowth::kRandomWalk ? std::sqrt(length) : length;
  return std::min(model_.rate * growth, model_.max);
}

bool RejectsTooMany(size_t num_rejected, size_t num_judged) {
  return static_cast<double>(num_rejected) >
         kMaxRejectedShare * static_cast<double>(num_judged);
}

}  // namespace mgsfm

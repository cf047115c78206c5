// SPDX-License-Identifier: BSD-3-Clause
#include "registration/point_matches.h"

#include <algorithm>
#include <cstddef>
#include <optional>
#include <utility>

#include "base/parallel.h"
#include "mgsfm/base/mask.h"
#include "scene/point_lookup.h"

namespace mgsfm {
namespace {

using Votes = std::vector<std::pair<int, int>>;  // keypoint, point

// The point with the most votes, per keypoint. Sorts the votes.
std::vector<PointMatch> CountVotes(Votes* votes) {
  std::sort(votes->begin(), votes->end());
  std::vector<PointMatch> matches;
  size_t most = 0;
  for (size_t begin = 0, end = 0; begin < votes->size(); begin = end) {
    const auto& [keypoint_idx, point_idx] = (*votes)[begin];
    while (end < votes->size() && (*votes)[end] == (*votes)[begin]) ++end;
    const bool is_new =
        matches.empty() || matches.back().keypoint_idx != keypoint_idx;
    if (is_new) {
      matches.push_back({keypoint_idx, point_idx});
    } else if (end - begin > most) {
      matches.back().point_idx = point_idx;
    } else {
      continue;
    }
    most = end - begin;
  }
  return matches;
}

}  // namespace

std::vector<std::vector<PointMatch>> FindPointMatches(
    const Scene& scene, const ViewGraph& view_graph,
    const Reconstruction& model, const Mask& is_wanted, int num_threads) {
  const PointLookup lookup(scene, model);
  std::vector<Votes> votes(scene.images.size());
  for (const ImagePair& pair : view_graph.pairs) {
    if (is_wanted[pair.image_idx1]) {
      for (const Match& match : pair.matches) {
        const std::optional<int> point =
            lookup.Find(pair.image_idx2, match.keypoint_idx2);
        if (!point) continue;
        votes[pair.image_idx1].emplace_back(match.keypoint_idx1, *point);
      }
    }
    if (is_wanted[pair.image_idx2]) {
      for (const Match& match : pair.matches) {
        const std::optional<int> point =
            lookup.Find(pair.image_idx1, match.keypoint_idx1);
        if (!point) continue;
        votes[pair.image_idx2].emplace_back(match.keypoint_idx2, *point);
      }
    }
  }
  std::vector<std::vector<PointMatch>> matches(scene.images.size());
  ParallelFor(scene.images.size(), num_threads,
              [&](size_t i) { matches[i] = CountVotes(&votes[i]); });
  return matches;
}

}  // namespace mgsfm

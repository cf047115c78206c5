// SPDX-License-Identifier: BSD-3-Clause
#include "mgsfm/scene/view_graph.h"

#include <algorithm>
#include <utility>

namespace mgsfm {

std::vector<Match> AllMatches(const ImagePair& pair) {
  std::vector<Match> matches = pair.matches;
  matches.insert(matches.end(), pair.outliers.begin(), pair.outliers.end());
  return matches;
}

std::vector<Match> OutliersOf(const std::vector<Match>& all_matches,
                              const std::vector<Match>& inliers) {
  std::vector<uint32_t> taken1, taken2;
  for (const Match& match : inliers) {
    taken1.push_back(match.keypoint_idx1);
    taken2.push_back(match.keypoint_idx2);
  }
  std::sort(taken1.begin(), taken1.end());
  std::sort(taken2.begin(), taken2.end());
  std::vector<Match> outliers;
  for (const Match& match : all_matches) {
    if (!std::binary_search(taken1.begin(), taken1.end(),
                            match.keypoint_idx1) &&
        !std::binary_search(taken2.begin(), taken2.end(),
                            match.keypoint_idx2)) {
      outliers.push_back(match);
    }
  }
  return outliers;
}

const ImagePair* FindPair(const ViewGraph& view_graph, int image_idx1,
                          int image_idx2) {
  const auto images_of = [](const ImagePair& pair) {
    return std::pair(pair.image_idx1, pair.image_idx2);
  };
  const std::pair wanted(image_idx1, image_idx2);
  const auto& pairs = view_graph.pairs;
  const auto found = std::lower_bound(
      pairs.begin(), pairs.end(), wanted,
      [&](const ImagePair& pair, const std::pair<int, int>& images) {
        return images_of(pair) < images;
      });
  if (found == pairs.end() || images_of(*found) != wanted) return nullptr;
  return &*found;
}

}  // namespace mgsfm

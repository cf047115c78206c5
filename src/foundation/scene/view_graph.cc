// SPDX-License-Identifier: BSD-3-Clause
#include "mgsfm/scene/view_graph.h"

#include <algorithm>
#include <utility>

#include "base/ranges.h"

namespace mgsfm {

std::vector<Match> AllMatches(const ImagePair& pair) {
  std::vector<Match> matches = pair.matches;
  matches.insert(matches.end(), pair.outliers.begin(), pair.outliers.end());
  return matches;
}

std::vector<Match> OutliersOf(const std::vector<Match>& all_matches,
                              const std::vector<Match>& inliers) {
  const auto is_taken = [&](uint32_t Match::*keypoint_idx) {
    std::vector<uint32_t> taken = Transformed(inliers, keypoint_idx);
    std::sort(taken.begin(), taken.end());
    return [=](const Match& match) {
      return std::binary_search(taken.begin(), taken.end(),
                                match.*keypoint_idx);
    };
  };
  std::vector<Match> outliers = all_matches;
  EraseIf(&outliers, is_taken(&Match::keypoint_idx1));
  EraseIf(&outliers, is_taken(&Match::keypoint_idx2));
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

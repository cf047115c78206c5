// SPDX-License-Identifier: BSD-3-Clause
#include "pair_filtering/triplet_consistency.h"

#include <algorithm>
#include <cstddef>
#include <cstdint>

#include "base/parallel.h"
#include "math/sorted_adjacency.h"
#include "mgsfm/base/error.h"
#include "mgsfm/base/mask.h"

namespace mgsfm {
namespace {

// Numbers the keypoints of all images that have matches, image by image.
class KeypointNumbers {
 public:
  explicit KeypointNumbers(const ViewGraph& view_graph) {
    std::vector<uint32_t> num_keypoints;
    const auto count = [&](int image_idx, uint32_t keypoint_idx) {
      if (num_keypoints.size() <= static_cast<size_t>(image_idx)) {
        num_keypoints.resize(image_idx + 1, 0);
      }
      uint32_t& num = num_keypoints[image_idx];
      num = std::max(num, keypoint_idx + 1);
    };
    for (const ImagePair& pair : view_graph.pairs) {
      for (const Match& match : pair.matches) {
        count(pair.image_idx1, match.keypoint_idx1);
        count(pair.image_idx2, match.keypoint_idx2);
      }
    }
    for (const uint32_t num : num_keypoints) {
      first_.push_back(static_cast<uint32_t>(size_));
      size_ += num;
    }
    MGSFM_CHECK_LT(size_, size_t{UINT32_MAX});
  }

  size_t size() const { return size_; }
  uint32_t First(const ImagePair& pair, const Match& match) const {
    return first_[pair.image_idx1] + match.keypoint_idx1;
  }
  uint32_t Second(const ImagePair& pair, const Match& match) const {
    return first_[pair.image_idx2] + match.keypoint_idx2;
  }

 private:
  std::vector<uint32_t> first_;  // per image
  size_t size_ = 0;
};

// Per pair: the number of matches of all pairs before it.
std::vector<size_t> FirstMatches(const ViewGraph& view_graph) {
  std::vector<size_t> first = {0};
  for (const ImagePair& pair : view_graph.pairs) {
    first.push_back(first.back() + pair.matches.size());
  }
  return first;
}

}  // namespace

Mask FindTripletConsistentMatches(const ViewGraph& view_graph,
                                  const Mask& pair_is_used, int num_threads) {
  MGSFM_CHECK_EQ(pair_is_used.size(), view_graph.pairs.size());
  const KeypointNumbers numbers(view_graph);
  const SortedAdjacency adjacency(numbers.size(), [&](const auto& visit) {
    for (size_t i = 0; i < view_graph.pairs.size(); ++i) {
      if (!pair_is_used[i]) continue;
      const ImagePair& pair = view_graph.pairs[i];
      for (const Match& match : pair.matches) {
        visit(numbers.First(pair, match), numbers.Second(pair, match));
      }
    }
  });
  const std::vector<size_t> first_match = FirstMatches(view_graph);
  Mask is_triplet_consistent(first_match.back(), false);
  ParallelFor(
      view_graph.pairs.size(), num_threads,
      [&](size_t i) {
        if (!pair_is_used[i]) return;
        const ImagePair& pair = view_graph.pairs[i];
        for (size_t k = 0; k < pair.matches.size(); ++k) {
          is_triplet_consistent[first_match[i] + k] =
              adjacency.NumCommonNeighbours(
                  numbers.First(pair, pair.matches[k]),
                  numbers.Second(pair, pair.matches[k]), 1) > 0;
        }
      },
      256);
  return is_triplet_consistent;
}

std::vector<int> CountTripletConsistentMatches(const ViewGraph& view_graph,
                                               const Mask& pair_is_used,
                                               int num_threads) {
  const Mask is_triplet_consistent =
      FindTripletConsistentMatches(view_graph, pair_is_used, num_threads);
  std::vector<int> num_triplet_consistent;
  auto begin = is_triplet_consistent.begin();
  for (const ImagePair& pair : view_graph.pairs) {
    const auto end = begin + static_cast<std::ptrdiff_t>(pair.matches.size());
    num_triplet_consistent.push_back(
        static_cast<int>(std::count(begin, end, char{true})));
    begin = end;
  }
  return num_triplet_consistent;
}

}  // namespace mgsfm

// SPDX-License-Identifier: BSD-3-Clause
#include "pair_filtering/triplet_consistency.h"

#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <tuple>
#include <utility>

#include "base/parallel.h"
#include "base/ranges.h"
#include "math/sorted_adjacency.h"
#include "math/triangles.h"
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

// Per pair: the number of matches of all previous pairs; and of all.
template <class Pairs>
std::vector<size_t> FirstMatches(const Pairs& pairs) {
  std::vector<size_t> first = {0};
  for (const auto& pair : pairs) {
    first.push_back(first.back() + pair.matches.size());
  }
  return first;
}

// Per pair: the number of its matches that are set.
template <class Flags>
std::vector<int> CountPerPair(const Flags& flags,
                              const std::vector<size_t>& first_match) {
  const auto at = [&](size_t i) {
    return flags.begin() + static_cast<std::ptrdiff_t>(i);
  };
  std::vector<int> counts;
  for (size_t i = 0; i + 1 < first_match.size(); ++i) {
    counts.push_back(static_cast<int>(
        std::count_if(at(first_match[i]), at(first_match[i + 1]),
                      [](bool flag) { return flag; })));
  }
  return counts;
}

bool IsBefore(const Match& a, const Match& b) {
  return std::tie(a.keypoint_idx1, a.keypoint_idx2) <
         std::tie(b.keypoint_idx1, b.keypoint_idx2);
}

// The triplets of keypoints in triangles of images.
class TripletMarker {
 public:
  // Pairs and their matches are sorted. They must outlive this object.
  explicit TripletMarker(const std::vector<PairMatches>& pairs)
      : pairs_(pairs),
        first_match_(FirstMatches(pairs)),
        is_consistent_(first_match_.back(), false) {}

  // Marks the matches of three images a < b < c that form triplets. The
  // arguments are the pairs of (a, b), (a, c) and (b, c).
  void Mark(size_t ab, size_t ac, size_t bc) {
    const std::vector<Match>& of_ab = pairs_[ab].matches;
    const std::vector<Match>& of_ac = pairs_[ac].matches;
    size_t k = 0;
    for (size_t i = 0; i < of_ab.size(); ++i) {
      const uint32_t keypoint_idx = of_ab[i].keypoint_idx1;
      while (k < of_ac.size() && of_ac[k].keypoint_idx1 < keypoint_idx) ++k;
      for (size_t m = k;
           m < of_ac.size() && of_ac[m].keypoint_idx1 == keypoint_idx; ++m) {
        if (!MarkEqual(bc, {of_ab[i].keypoint_idx2, of_ac[m].keypoint_idx2})) {
          continue;
        }
        is_consistent_[first_match_[ab] + i] = true;
        is_consistent_[first_match_[ac] + m] = true;
      }
    }
  }

  std::vector<int> Counts() const {
    return CountPerPair(is_consistent_, first_match_);
  }

 private:
  // False if the pair has no such match.
  bool MarkEqual(size_t pair_idx, const Match& match) {
    const std::vector<Match>& matches = pairs_[pair_idx].matches;
    const auto [begin, end] =
        std::equal_range(matches.begin(), matches.end(), match, IsBefore);
    for (auto i = begin; i != end; ++i) {
      is_consistent_[first_match_[pair_idx] + (i - matches.begin())] = true;
    }
    return begin != end;
  }

  const std::vector<PairMatches>& pairs_;
  std::vector<size_t> first_match_;  // per pair
  std::vector<bool> is_consistent_;  // per match
};

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
  const std::vector<size_t> first_match = FirstMatches(view_graph.pairs);
  Mask is_triplet_consistent(first_match.back(), false);
  ParallelFor(
      view_graph.pairs.size(), num_threads,
      [&](size_t i) {
        if (!pair_is_used[i]) return;
        const ImagePair& pair = view_graph.pairs[i];
        for (size_t k = 0; k < pair.matches.size(); ++k) {
          is_triplet_consistent[first_match[i] + k] =
              adjacency.NumCommonNeighbors(
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
  return CountPerPair(
      FindTripletConsistentMatches(view_graph, pair_is_used, num_threads),
      FirstMatches(view_graph.pairs));
}

std::vector<int> CountTripletConsistentMatches(std::vector<PairMatches>* pairs,
                                               const Context& context) {
  for (PairMatches& pair : *pairs) {
    std::sort(pair.matches.begin(), pair.matches.end(), IsBefore);
  }
  TripletMarker marker(*pairs);
  const auto images_of_pairs = Transformed(*pairs, [](const PairMatches& pair) {
    return std::pair(pair.image_idx1, pair.image_idx2);
  });
  ForEachTriangle(images_of_pairs, [&](size_t ab, size_t ac, size_t bc) {
    context.CheckInterrupted();
    marker.Mark(ab, ac, bc);
  });
  return marker.Counts();
}

}  // namespace mgsfm

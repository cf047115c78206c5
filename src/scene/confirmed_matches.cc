// SPDX-License-Identifier: BSD-3-Clause
#include "mgsfm/scene/confirmed_matches.h"

#include <algorithm>
#include <cstddef>
#include <cstdint>

#include "mgsfm/base/error.h"

namespace mgsfm {
namespace {

// Keypoints of all images, numbered image by image, and those that each is
// matched with, ascending.
class MatchedKeypoints {
 public:
  MatchedKeypoints(const ViewGraph& view_graph,
                   const std::vector<char>& pair_is_used) {
    NumberKeypoints(view_graph);
    ForAllMatches(view_graph, pair_is_used, [this](size_t a, size_t b) {
      ++begin_[a + 1];
      ++begin_[b + 1];
    });
    for (size_t a = 1; a < begin_.size(); ++a) begin_[a] += begin_[a - 1];
    partners_.resize(begin_.back());
    std::vector<size_t> end(begin_.begin(), begin_.end() - 1);
    ForAllMatches(view_graph, pair_is_used, [this, &end](size_t a, size_t b) {
      partners_[end[a]++] = b;
      partners_[end[b]++] = a;
    });
    for (size_t a = 0; a + 1 < begin_.size(); ++a) {
      std::sort(Begin(a), Begin(a + 1));
    }
  }

  // Whether some keypoint is matched with both ends.
  bool IsConfirmed(const ImagePair& pair, const Match& match) {
    const size_t a = Keypoint(pair.image_idx1, match.keypoint_idx1);
    const size_t b = Keypoint(pair.image_idx2, match.keypoint_idx2);
    auto x = Begin(a), y = Begin(b);
    while (x != Begin(a + 1) && y != Begin(b + 1)) {
      if (*x == *y) return true;
      if (*x < *y) {
        ++x;
      } else {
        ++y;
      }
    }
    return false;
  }

 private:
  using Iterator = std::vector<size_t>::iterator;
  Iterator Begin(size_t keypoint) {
    return partners_.begin() + static_cast<std::ptrdiff_t>(begin_[keypoint]);
  }
  size_t Keypoint(int image_idx, uint32_t keypoint_idx) const {
    return first_[image_idx] + keypoint_idx;
  }

  void NumberKeypoints(const ViewGraph& view_graph) {
    std::vector<size_t> num_keypoints;
    const auto count = [&](int image_idx, uint32_t keypoint_idx) {
      if (num_keypoints.size() <= static_cast<size_t>(image_idx)) {
        num_keypoints.resize(image_idx + 1, 0);
      }
      num_keypoints[image_idx] =
          std::max<size_t>(num_keypoints[image_idx], keypoint_idx + 1);
    };
    for (const ImagePair& pair : view_graph.pairs) {
      for (const Match& match : pair.matches) {
        count(pair.image_idx1, match.keypoint_idx1);
        count(pair.image_idx2, match.keypoint_idx2);
      }
    }
    size_t num_all = 0;
    for (const size_t num : num_keypoints) {
      first_.push_back(num_all);
      num_all += num;
    }
    begin_.assign(num_all + 1, 0);
  }

  template <class Function>
  void ForAllMatches(const ViewGraph& view_graph,
                     const std::vector<char>& pair_is_used,
                     const Function& function) const {
    for (size_t i = 0; i < view_graph.pairs.size(); ++i) {
      if (!pair_is_used[i]) continue;
      const ImagePair& pair = view_graph.pairs[i];
      for (const Match& match : pair.matches) {
        function(Keypoint(pair.image_idx1, match.keypoint_idx1),
                 Keypoint(pair.image_idx2, match.keypoint_idx2));
      }
    }
  }

  std::vector<size_t> first_;     // per image
  std::vector<size_t> begin_;     // per keypoint, and the end
  std::vector<size_t> partners_;  // of all keypoints
};

}  // namespace

std::vector<int> CountConfirmedMatches(const ViewGraph& view_graph,
                                       const std::vector<char>& pair_is_used) {
  MGSFM_CHECK_EQ(pair_is_used.size(), view_graph.pairs.size());
  MatchedKeypoints keypoints(view_graph, pair_is_used);
  std::vector<int> num_confirmed(view_graph.pairs.size(), 0);
  for (size_t i = 0; i < num_confirmed.size(); ++i) {
    if (!pair_is_used[i]) continue;
    const ImagePair& pair = view_graph.pairs[i];
    num_confirmed[i] = static_cast<int>(std::count_if(
        pair.matches.begin(), pair.matches.end(), [&](const Match& match) {
          return keypoints.IsConfirmed(pair, match);
        }));
  }
  return num_confirmed;
}

}  // namespace mgsfm

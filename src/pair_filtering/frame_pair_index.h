// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <cstddef>
#include <vector>

#include "mgsfm/scene/scene.h"
#include "mgsfm/scene/view_graph.h"

namespace mgsfm {

// The pairs of a view graph by the frames of their images. All rules of pair
// filtering share one index.
class FramePairIndex {
 public:
  // All image pairs of two frames, or those within one frame.
  struct FramePair {
    int frame_idx1 = 0;  // <= frame_idx2
    int frame_idx2 = 0;
    std::vector<size_t> pair_idxs;  // ascending; never empty

    bool IsBetweenFrames() const { return frame_idx1 != frame_idx2; }
  };

  // Cost: O(n log n) for n pairs.
  FramePairIndex(const Scene& scene, const ViewGraph& view_graph);

  int num_frames() const { return num_frames_; }
  size_t num_pairs() const { return frame_pair_of_pair_.size(); }
  // Sorted by (frame_idx1, frame_idx2), each at most once.
  const std::vector<FramePair>& frame_pairs() const { return frame_pairs_; }
  const FramePair& Of(size_t pair_idx) const {
    return frame_pairs_[frame_pair_of_pair_[pair_idx]];
  }

 private:
  int num_frames_ = 0;
  std::vector<FramePair> frame_pairs_;
  std::vector<size_t> frame_pair_of_pair_;  // per image pair
};

}  // namespace mgsfm

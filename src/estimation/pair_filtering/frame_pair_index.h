// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <cstddef>
#include <optional>
#include <vector>

#include "mgsfm/base/mask.h"
#include "mgsfm/pair_filtering/pair_filtering.h"
#include "mgsfm/scene/scene.h"
#include "mgsfm/scene/view_graph.h"
#include "pair_filtering/temporal_order.h"

namespace mgsfm {

// The part of an ImagePair that the index needs.
struct MatchedImages {
  int image_idx1 = 0;
  int image_idx2 = 0;
  size_t num_matches = 0;
};

// The pairs of a view graph by the frames of their images. All rules of pair
// filtering share one index.
class FramePairIndex {
 public:
  // All image pairs of two frames, or those within one frame.
  struct FramePair {
    int frame_idx1 = 0;  // <= frame_idx2
    int frame_idx2 = 0;
    std::vector<size_t> pair_idxs;  // ascending; never empty
    // Difference of the ranks of the frames in a sequence; nullopt if the
    // frames are not of one sequence.
    std::optional<int> time_gap = std::nullopt;

    bool IsBetweenFrames() const { return frame_idx1 != frame_idx2; }
  };

  // `sequence` states whether the frames are in temporal order. Cost:
  // O(n log n) for n pairs.
  FramePairIndex(const Scene& scene, const ViewGraph& view_graph,
                 SequenceMode sequence = SequenceMode::kAuto);
  FramePairIndex(const Scene& scene, const std::vector<MatchedImages>& pairs,
                 SequenceMode sequence);

  int num_frames() const { return num_frames_; }
  bool is_sequence() const { return order_.has_value(); }
  // nullopt if the frames are not in temporal order.
  const std::optional<TemporalOrder>& order() const { return order_; }
  // The number of frames for which points stay in view: the largest gap up to
  // which, at each gap, an image pair links at least half of
  // the pairs of frames. At least 1, and per rig.
  int Reach(const FramePair& frames) const {
    return reaches_[rig_of_frame_[frames.frame_idx1]];
  }
  // The frames are of one sequence, and within its reach.
  bool AreNeighbors(const FramePair& frames) const {
    return frames.time_gap && *frames.time_gap <= Reach(frames);
  }
  // The frames are further apart in a sequence, or of different sequences.
  bool IsLoop(const FramePair& frames) const {
    return is_sequence() && !AreNeighbors(frames);
  }
  size_t num_pairs() const { return frame_pair_of_pair_.size(); }
  // Sorted by (frame_idx1, frame_idx2), each at most once.
  const std::vector<FramePair>& frame_pairs() const { return frame_pairs_; }
  // The pair of two frames in any order; nullptr if no image pair has them.
  const FramePair* Find(int frame_idx1, int frame_idx2) const;
  const FramePair& Of(size_t pair_idx) const {
    return frame_pairs_[frame_pair_of_pair_[pair_idx]];
  }

 private:
  int num_frames_ = 0;
  std::optional<TemporalOrder> order_;
  std::vector<int> rig_of_frame_;
  std::vector<int> reaches_;  // per rig
  std::vector<FramePair> frame_pairs_;
  std::vector<size_t> frame_pair_of_pair_;  // per image pair
};

// The pairs that a rule judges, and what it may use.
struct PairEvidence {
  const Scene& scene;
  const FramePairIndex& index;  // of the view graph
  const ViewGraph& view_graph;
  const Mask& pair_is_used;
  const PairFilteringOptions& options;
  int num_threads = 1;
};

}  // namespace mgsfm

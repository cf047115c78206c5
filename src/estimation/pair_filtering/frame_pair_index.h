// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <cstddef>
#include <optional>
#include <vector>

#include "mgsfm/base/mask.h"
#include "mgsfm/pair_filtering/pair_filtering.h"
#include "mgsfm/scene/scene.h"
#include "mgsfm/scene/view_graph.h"

namespace mgsfm {

// The frames of each rig in the order of their capture times, or of their names
// ("9" before "10") if not all images of the rig have a time. Numbers in names
// then indicate time: a missing frame leaves a gap. Changes by more than ten
// median intervals are not counts: they indicate the next minute of a date, or
// another recording.
class TemporalOrder {
 public:
  explicit TemporalOrder(const Scene& scene);

  int RigOf(int frame_idx) const { return rig_of_frame_[frame_idx]; }
  // 1 for consecutive frames; nullopt for frames of different rigs.
  std::optional<int> Gap(int frame_idx1, int frame_idx2) const;
  // Both frames must be of one rig.
  bool IsBefore(int frame_idx1, int frame_idx2) const {
    return rank_of_frame_[frame_idx1] < rank_of_frame_[frame_idx2];
  }
  // The frame before a frame of the same rig; nullopt for its first one.
  std::optional<int> Previous(int frame_idx) const {
    const int rank = rank_of_frame_[frame_idx];
    if (rank == 0) return std::nullopt;
    return sequences_[rig_of_frame_[frame_idx]][rank - 1];
  }
  // The frames before and after a frame of the same rig.
  std::vector<int> Neighbors(int frame_idx) const;
  // Time from a frame to the next frame of the same rig, relative to the
  // median; 1 if neither times nor numbers in names indicate it.
  double Duration(int frame_idx, int next_frame_idx) const {
    return time_of_frame_[next_frame_idx] - time_of_frame_[frame_idx];
  }
  // Whether a frame is more than ten median intervals later than the previous
  // frame, or an unknown time later if other times are known.
  bool IsAfterBreak(int frame_idx) const { return is_after_break_[frame_idx]; }
  // The frames of each rig, in their order.
  const std::vector<std::vector<int>>& sequences() const { return sequences_; }

 private:
  std::vector<int> rig_of_frame_;
  std::vector<int> rank_of_frame_;     // within its rig
  std::vector<double> time_of_frame_;  // in median intervals of its rig
  Mask is_after_break_;
  std::vector<std::vector<int>> sequences_;
};

// Neighbors in a sequence, since one frame may be missing or blurred.
inline constexpr int kMaxNeighborGap = 2;

// The part of an ImagePair that the index needs.
struct MatchedImages {
  int image_idx1 = 0;
  int image_idx2 = 0;
  size_t num_matches = 0;
};

// All image pairs of two frames, or those within one frame.
struct FramePair {
  int frame_idx1 = 0;  // <= frame_idx2
  int frame_idx2 = 0;
  std::vector<size_t> pair_idxs;  // ascending; never empty
  // Difference of the ranks of the frames in a sequence; nullopt if the frames
  // are not of one sequence.
  std::optional<int> time_gap = std::nullopt;

  bool IsBetweenFrames() const { return frame_idx1 != frame_idx2; }
};

// The pairs of a view graph by the frames of their images. All rules of pair
// filtering share one index.
class FramePairIndex {
 public:
  // `sequence` states whether the frames are in temporal order. Cost:
  // O(n log n) for n pairs.
  FramePairIndex(const Scene& scene, const ViewGraph& view_graph,
                 SequenceMode sequence = SequenceMode::kAuto);
  FramePairIndex(const Scene& scene, const std::vector<MatchedImages>& pairs,
                 SequenceMode sequence);
  // The pairs of a part of a view graph. Order and reach are those of the
  // whole: few pairs do not show them.
  FramePairIndex(const Scene& scene, const ViewGraph& view_graph,
                 const FramePairIndex& whole);

  int num_frames() const { return num_frames_; }
  bool is_sequence() const { return order_.has_value(); }
  // nullopt if the frames are not in temporal order.
  const std::optional<TemporalOrder>& order() const { return order_; }
  // The number of frames for which points stay in view: the largest gap up to
  // which, at each gap, an image pair links at least half of
  // the pairs of frames. At least 1, and per rig.
  int Reach(const FramePair& frames) const {
    return reaches_[order_->RigOf(frames.frame_idx1)];
  }
  // The frames are of one sequence, and within its reach.
  bool AreNeighbors(const FramePair& frames) const {
    return frames.time_gap && *frames.time_gap <= Reach(frames);
  }
  // The same for two frames that no image pair may have.
  bool AreNear(int frame_idx1, int frame_idx2) const {
    return is_sequence() && AreNeighbors({frame_idx1,
                                          frame_idx2,
                                          {},
                                          order_->Gap(frame_idx1, frame_idx2)});
  }
  // The frames are further apart in a sequence, or of different sequences.
  bool IsLoop(const FramePair& frames) const {
    return is_sequence() && !AreNeighbors(frames);
  }
  size_t num_pairs() const { return frame_pair_of_pair_.size(); }
  // Sorted by (frame_idx1, frame_idx2), each at most once.
  const std::vector<FramePair>& frame_pairs() const { return frame_pairs_; }
  // The same with the image pairs of a mask only, for frames that have any.
  std::vector<FramePair> FramePairsOf(const Mask& pairs) const;
  // The pair of two frames in any order; nullptr if no image pair has them.
  const FramePair* Find(int frame_idx1, int frame_idx2) const;
  const FramePair& Of(size_t pair_idx) const {
    return frame_pairs_[frame_pair_of_pair_[pair_idx]];
  }

 private:
  int num_frames_ = 0;
  std::optional<TemporalOrder> order_;
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

// Groups rejected pairs whose first frames, and whose second frames, are at
// most three apart in the order of the scene. Largest group first.
std::vector<RejectedGroup> GroupRejectedPairs(const FramePairIndex& index,
                                              const Mask& pair_is_rejected);

}  // namespace mgsfm

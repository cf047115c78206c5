// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <optional>
#include <vector>

#include "mgsfm/base/mask.h"
#include "mgsfm/scene/scene.h"

namespace mgsfm {

// The frames of each rig in the order of their capture times, or of their names
// ("9" before "10") if not all images of the rig have a time. Numbers in names
// then indicate time: a missing frame leaves a gap. Changes by more than ten
// median intervals are not counts: they indicate the next minute of a date, or
// another recording.
class TemporalOrder {
 public:
  explicit TemporalOrder(const Scene& scene);

  // 1 for consecutive frames; nullopt for frames of different rigs.
  std::optional<int> Gap(int frame_idx1, int frame_idx2) const;
  // Both frames must be of one rig.
  bool IsBefore(int frame_idx1, int frame_idx2) const {
    return rank_of_frame_[frame_idx1] < rank_of_frame_[frame_idx2];
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

}  // namespace mgsfm

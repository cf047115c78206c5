// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <cstddef>
#include <optional>
#include <vector>

#include "math/graph.h"

namespace mgsfm {

// The cuts of a graph of frames that its maximum spanning forest defines:
// removing an edge of the forest splits its tree into the frames below the edge
// and the others. Every weak cut of the graph is near one of these cuts,
// because the forest crosses it by its strongest edge.
class FrameCuts {
 public:
  struct Cut {
    int frame_below = 0;  // ends of the removed edge
    int frame_above = 0;
  };

  FrameCuts(int num_frames, const std::vector<GraphEdge>& edges);

  int num_frames() const { return static_cast<int>(parent_.size()); }
  const std::vector<Cut>& cuts() const { return cuts_; }

  // The core of a tree is a frame that no cut separates from more than half of
  // its frames.
  bool CoreIsAbove(size_t cut_idx) const;
  // Ascending.
  std::vector<int> FramesOfSide(size_t cut_idx, bool is_below) const;
  // Per frame: the smallest value of the cuts between it and the core of its
  // tree; 1 for the core.
  std::vector<double> SmallestToCore(
      const std::vector<double>& value_of_cut) const;

  // The cut with the smallest value among those that separate two frames;
  // nullopt if the frames are equal or of different trees.
  template <class Value>
  std::optional<size_t> SmallestBetween(
      int frame_idx1, int frame_idx2,
      const std::vector<Value>& value_of_cut) const {
    if (root_[frame_idx1] != root_[frame_idx2]) return std::nullopt;
    const int ancestor = CommonAncestor(frame_idx1, frame_idx2);
    std::optional<size_t> smallest;
    for (const int end : {frame_idx1, frame_idx2}) {
      for (int frame = end; frame != ancestor; frame = parent_[frame]) {
        const size_t cut = *cut_above_[frame];
        if (!smallest || value_of_cut[cut] < value_of_cut[*smallest]) {
          smallest = cut;
        }
      }
    }
    return smallest;
  }

  // Adds amounts to all cuts that separate two frames. Frames of different
  // trees do not count.
  class Sums {
   public:
    explicit Sums(const FrameCuts& cuts);
    void Add(int frame_idx1, int frame_idx2, double amount);
    // Adds the amount once to each cut that separates any two of the frames.
    // Returns the frames in depth-first order.
    std::vector<int> AddGroup(std::vector<int> frame_idxs, double amount);
    // Adds the amount once to each cut that has at least two of the frames on
    // each side.
    void AddTies(const std::vector<int>& frame_idxs, double amount);
    // Per cut.
    std::vector<double> Finish() const;

   private:
    int JunctionOf(const std::vector<int>& sorted, size_t idx) const;

    const FrameCuts& cuts_;
    std::vector<double> at_frame_;  // sums over a subtree make that of its edge
  };

 private:
  int CommonAncestor(int frame_idx1, int frame_idx2) const;
  int NumBelow(int frame_idx) const {  // with the frame itself
    return leave_[frame_idx] - enter_[frame_idx];
  }

  std::vector<Cut> cuts_;  // in depth-first order of frame_below
  // Per frame.
  std::vector<int> parent_;                       // itself for roots
  std::vector<std::optional<size_t>> cut_above_;  // nullopt for roots
  std::vector<int> depth_;
  std::vector<int> root_;
  std::vector<int>
      enter_;  // frames below a frame are entered in [enter, leave)
  std::vector<int> leave_;
  std::vector<int> order_;  // frames by enter_
};

}  // namespace mgsfm

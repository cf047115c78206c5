// SPDX-License-Identifier: BSD-3-Clause
#include "pair_filtering/frame_cuts.h"

#include <algorithm>

#include "base/ranges.h"
#include "math/spanning_tree.h"

namespace mgsfm {

FrameCuts::FrameCuts(int num_frames, const std::vector<GraphEdge>& edges)
    : parent_(num_frames),
      cut_above_(num_frames),
      depth_(num_frames, 0),
      root_(num_frames),
      enter_(num_frames, 0),
      leave_(num_frames),
      order_(num_frames) {
  const std::vector<ForestStep> steps =
      WalkForest(num_frames, edges, MaximumSpanningForest(num_frames, edges));
  std::vector<int> num_below(num_frames, 1);  // with the frame itself
  for (auto step = steps.rbegin(); step != steps.rend(); ++step) {
    if (step->from) num_below[step->from->parent] += num_below[step->node];
  }
  // Each frame hands out consecutive numbers to its subtrees.
  std::vector<int> next(num_frames);
  int next_of_roots = 0;
  for (const ForestStep& step : steps) {
    const int frame = step.node;
    int& position = step.from ? next[step.from->parent] : next_of_roots;
    enter_[frame] = position;
    leave_[frame] = position += num_below[frame];
    next[frame] = enter_[frame] + 1;
    parent_[frame] = step.from ? step.from->parent : frame;
    root_[frame] = step.from ? root_[parent_[frame]] : frame;
    depth_[frame] = step.from ? depth_[parent_[frame]] + 1 : 0;
    order_[enter_[frame]] = frame;
  }
  for (const int frame : order_) {
    if (parent_[frame] == frame) continue;
    cut_above_[frame] = cuts_.size();
    cuts_.push_back({frame, parent_[frame]});
  }
}

bool FrameCuts::CoreIsAbove(size_t cut_idx) const {
  const int frame = cuts_[cut_idx].frame_below;
  return 2 * NumBelow(frame) <= NumBelow(root_[frame]);
}

std::vector<int> FrameCuts::FramesOfSide(size_t cut_idx, bool is_below) const {
  const int frame = cuts_[cut_idx].frame_below;
  const int root = root_[frame];
  std::vector<int> frames;
  const auto append = [&](int begin, int end) {
    frames.insert(frames.end(), order_.begin() + begin, order_.begin() + end);
  };
  if (is_below) {
    append(enter_[frame], leave_[frame]);
  } else {
    append(enter_[root], enter_[frame]);
    append(leave_[frame], leave_[root]);
  }
  std::sort(frames.begin(), frames.end());
  return frames;
}

// The cuts with the core below form the path from the root to the core. Values
// are passed up along this path first, then down everywhere.
std::vector<double> FrameCuts::SmallestToCore(
    const std::vector<double>& value_of_cut) const {
  std::vector<double> smallest(order_.size(), 1.0);
  for (size_t k = cuts_.size(); k-- > 0;) {
    const auto& [below, above] = cuts_[k];
    if (!CoreIsAbove(k)) {
      smallest[above] = std::min(smallest[below], value_of_cut[k]);
    }
  }
  for (size_t k = 0; k < cuts_.size(); ++k) {
    const auto& [below, above] = cuts_[k];
    if (CoreIsAbove(k)) {
      smallest[below] = std::min(smallest[above], value_of_cut[k]);
    }
  }
  return smallest;
}

int FrameCuts::CommonAncestor(int frame_idx1, int frame_idx2) const {
  int a = frame_idx1, b = frame_idx2;
  while (a != b) {
    int& lower = depth_[a] >= depth_[b] ? a : b;
    lower = parent_[lower];
  }
  return a;
}

FrameCuts::Sums::Sums(const FrameCuts& cuts)
    : cuts_(cuts), at_frame_(cuts.parent_.size(), 0.0) {}

void FrameCuts::Sums::Add(int frame_idx1, int frame_idx2, double amount) {
  if (cuts_.root_[frame_idx1] != cuts_.root_[frame_idx2]) return;
  at_frame_[frame_idx1] += amount;
  at_frame_[frame_idx2] += amount;
  at_frame_[cuts_.CommonAncestor(frame_idx1, frame_idx2)] -= 2.0 * amount;
}

// A closed depth-first tour through the frames passes each edge between them
// exactly twice.
std::vector<int> FrameCuts::Sums::AddGroup(std::vector<int> frame_idxs,
                                           double amount) {
  SortBy(&frame_idxs, [this](int a) { return cuts_.enter_[a]; });
  for (size_t i = 0; i < frame_idxs.size(); ++i) {
    Add(frame_idxs[i], frame_idxs[(i + 1) % frame_idxs.size()], 0.5 * amount);
  }
  return frame_idxs;
}

void FrameCuts::Sums::AddTies(const std::vector<int>& frame_idxs,
                              double amount) {
  const auto is_elsewhere = [&](int frame) {
    return cuts_.root_[frame] != cuts_.root_[frame_idxs.front()];
  };
  if (frame_idxs.size() < 4 || AnyOf(frame_idxs, is_elsewhere)) {
    return;
  }
  const std::vector<int> sorted = AddGroup(frame_idxs, amount);
  for (size_t i = 0; i < sorted.size(); ++i) {
    Add(sorted[i], JunctionOf(sorted, i), -amount);
  }
}

// The frame where the path from one of the frames reaches the tree that joins
// the other frames: a common ancestor, or a frame on the path to a neighbor in
// depth-first order.
int FrameCuts::Sums::JunctionOf(const std::vector<int>& sorted,
                                size_t idx) const {
  const int frame = sorted[idx];
  const int first = sorted[idx == 0 ? 1 : 0];
  const int last = sorted[sorted.size() - (idx + 1 == sorted.size() ? 2 : 1)];
  const int top = cuts_.CommonAncestor(first, last);
  if (cuts_.CommonAncestor(frame, top) != top) return top;
  int junction = top;
  for (const size_t other : {idx - 1, idx + 1}) {
    if (other >= sorted.size()) continue;
    const int ancestor = cuts_.CommonAncestor(frame, sorted[other]);
    if (cuts_.depth_[ancestor] > cuts_.depth_[junction]) junction = ancestor;
  }
  return junction;
}

std::vector<double> FrameCuts::Sums::Finish() const {
  std::vector<double> before(cuts_.order_.size() + 1, 0.0);
  for (size_t i = 0; i < cuts_.order_.size(); ++i) {
    before[i + 1] = before[i] + at_frame_[cuts_.order_[i]];
  }
  return Transformed(cuts_.cuts_, [&](const Cut& cut) {
    return before[cuts_.leave_[cut.frame_below]] -
           before[cuts_.enter_[cut.frame_below]];
  });
}

}  // namespace mgsfm

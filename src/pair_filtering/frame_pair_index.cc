// SPDX-License-Identifier: BSD-3-Clause
#include "pair_filtering/frame_pair_index.h"

#include <algorithm>
#include <tuple>
#include <utility>

namespace mgsfm {
namespace {

// One frame may be missing or blurred.
constexpr int kMaxNeighbourGap = 2;
// A random order of n frames would have a share of about 4 / n.
constexpr double kMinShareOfNeighbours = 0.75;

// Whether the order of the frames is that of a camera path: most frames share
// more matches with a frame just before or after them than with any other frame
// of their rig. Among n frames in random order, a share of about 4 / n would.
bool IsSequence(const std::vector<FramePairIndex::FramePair>& frame_pairs,
                const ViewGraph& view_graph, const TemporalOrder& order,
                int num_frames) {
  struct Partner {
    size_t num_matches = 0;
    bool is_neighbour = false;
  };
  std::vector<Partner> strongest(num_frames);
  for (const FramePairIndex::FramePair& frames : frame_pairs) {
    const auto gap = order.Gap(frames.frame_idx1, frames.frame_idx2);
    if (!frames.IsBetweenFrames() || !gap) continue;
    size_t num_matches = 0;
    for (const size_t i : frames.pair_idxs) {
      num_matches += view_graph.pairs[i].matches.size();
    }
    for (const int frame_idx : {frames.frame_idx1, frames.frame_idx2}) {
      Partner& partner = strongest[frame_idx];
      if (num_matches > partner.num_matches) {
        partner = {num_matches, *gap <= kMaxNeighbourGap};
      }
    }
  }
  size_t num_matched = 0, num_with_neighbour = 0;
  for (const Partner& partner : strongest) {
    num_matched += partner.num_matches > 0;
    num_with_neighbour += partner.is_neighbour;
  }
  return num_matched > 0 &&
         static_cast<double>(num_with_neighbour) >=
             kMinShareOfNeighbours * static_cast<double>(num_matched);
}

}  // namespace

FramePairIndex::FramePairIndex(const Scene& scene, const ViewGraph& view_graph,
                               SequenceMode sequence)
    : num_frames_(static_cast<int>(scene.frames.size())),
      frame_pair_of_pair_(view_graph.pairs.size()) {
  std::vector<std::tuple<int, int, size_t>> order;
  order.reserve(view_graph.pairs.size());
  for (size_t i = 0; i < view_graph.pairs.size(); ++i) {
    const ImagePair& pair = view_graph.pairs[i];
    const auto [low, high] =
        std::minmax({scene.images[pair.image_idx1].frame_idx,
                     scene.images[pair.image_idx2].frame_idx});
    order.emplace_back(low, high, i);
  }
  std::sort(order.begin(), order.end());
  for (const auto& [low, high, i] : order) {
    if (frame_pairs_.empty() || frame_pairs_.back().frame_idx1 != low ||
        frame_pairs_.back().frame_idx2 != high) {
      frame_pairs_.push_back({low, high, {}});
    }
    frame_pairs_.back().pair_idxs.push_back(i);
    frame_pair_of_pair_[i] = frame_pairs_.size() - 1;
  }
  if (sequence == SequenceMode::kNo) return;
  TemporalOrder order_of_frames(scene);
  if (sequence == SequenceMode::kAuto &&
      !IsSequence(frame_pairs_, view_graph, order_of_frames, num_frames_)) {
    return;
  }
  order_ = std::move(order_of_frames);
  for (FramePair& frames : frame_pairs_) {
    frames.time_gap = order_->Gap(frames.frame_idx1, frames.frame_idx2);
  }
}

const FramePairIndex::FramePair* FramePairIndex::Find(int frame_idx1,
                                                      int frame_idx2) const {
  const std::pair<int, int> wanted = std::minmax(frame_idx1, frame_idx2);
  const auto frames_of = [](const FramePair& frames) {
    return std::pair(frames.frame_idx1, frames.frame_idx2);
  };
  const auto found =
      std::lower_bound(frame_pairs_.begin(), frame_pairs_.end(), wanted,
                       [&](const FramePair& frames, const auto& value) {
                         return frames_of(frames) < value;
                       });
  return found != frame_pairs_.end() && frames_of(*found) == wanted ? &*found
                                                                    : nullptr;
}

}  // namespace mgsfm

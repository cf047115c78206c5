// SPDX-License-Identifier: BSD-3-Clause
#include "pair_filtering/frame_pair_index.h"

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <tuple>
#include <utility>

namespace mgsfm {
namespace {

// One frame may be missing or blurred.
constexpr int kMaxNeighbourGap = 2;
// Simulated drives have shares of 0.98 to 1, in random order 0.05.
constexpr double kMinShareOfNeighbours = 0.75;
constexpr double kMaxShareInRandomOrder = 0.25;

// The matches of two frames of a rig.
struct FrameLink {
  int frame_idx1 = 0, frame_idx2 = 0;
  size_t num_matches = 0;
  bool are_neighbours = false;
};

std::vector<FrameLink> LinksOfRigs(
    const std::vector<FramePairIndex::FramePair>& frame_pairs,
    const std::vector<MatchedImages>& pairs, const TemporalOrder& order) {
  std::vector<FrameLink> links;
  for (const FramePairIndex::FramePair& frames : frame_pairs) {
    const auto gap = order.Gap(frames.frame_idx1, frames.frame_idx2);
    if (!frames.IsBetweenFrames() || !gap) continue;
    links.push_back(
        {frames.frame_idx1, frames.frame_idx2, 0, *gap <= kMaxNeighbourGap});
    for (const size_t i : frames.pair_idxs) {
      links.back().num_matches += pairs[i].num_matches;
    }
  }
  return links;
}

// The expected share of frames that share half of their `most` matches with one
// of 2 * kMaxNeighbourGap frames drawn at random.
double ShareInRandomOrder(const std::vector<FrameLink>& links,
                          const std::vector<size_t>& most, double num_frames) {
  double num_strong = 0.0;
  for (const FrameLink& link : links) {
    num_strong += 2 * link.num_matches >= most[link.frame_idx1];
    num_strong += 2 * link.num_matches >= most[link.frame_idx2];
  }
  const double density = num_strong / (num_frames * (num_frames - 1.0));
  return 1.0 - std::pow(1.0 - density, 2 * kMaxNeighbourGap);
}

// Whether the order of the frames is that of a camera path: most frames share
// at least half as many matches with a frame just before or after them as with
// any other frame of their rig. A frame at a place that the path visits again
// may share more with the other visit. In a random order, few frames would do
// so; among few frames that all match, too many, and most frames must then
// share more matches with a neighbour than with any other frame.
bool IsSequence(const std::vector<FrameLink>& links, int num_frames) {
  // Per frame: the most matches with any frame, and with a neighbour in time.
  std::vector<size_t> most(num_frames, 0), most_with_neighbour = most;
  for (const FrameLink& link : links) {
    for (const int frame_idx : {link.frame_idx1, link.frame_idx2}) {
      most[frame_idx] = std::max(most[frame_idx], link.num_matches);
      if (!link.are_neighbours) continue;
      most_with_neighbour[frame_idx] =
          std::max(most_with_neighbour[frame_idx], link.num_matches);
    }
  }
  double num_matched = 0.0, num_with_strongest = 0.0, num_with_strong = 0.0;
  for (size_t i = 0; i < most.size(); ++i) {
    if (most[i] == 0) continue;
    num_matched += 1.0;
    num_with_strongest += most_with_neighbour[i] == most[i];
    num_with_strong += 2 * most_with_neighbour[i] >= most[i];
  }
  const double min_number = kMinShareOfNeighbours * num_matched;
  return num_matched > 0.0 && num_with_strong >= min_number &&
         (num_with_strongest >= min_number ||
          ShareInRandomOrder(links, most, num_matched) <=
              kMaxShareInRandomOrder);
}

std::vector<MatchedImages> CountMatches(const ViewGraph& view_graph) {
  std::vector<MatchedImages> pairs;
  pairs.reserve(view_graph.pairs.size());
  for (const ImagePair& pair : view_graph.pairs) {
    pairs.push_back({pair.image_idx1, pair.image_idx2, pair.matches.size()});
  }
  return pairs;
}

}  // namespace

FramePairIndex::FramePairIndex(const Scene& scene, const ViewGraph& view_graph,
                               SequenceMode sequence)
    : FramePairIndex(scene, CountMatches(view_graph), sequence) {}

FramePairIndex::FramePairIndex(const Scene& scene,
                               const std::vector<MatchedImages>& pairs,
                               SequenceMode sequence)
    : num_frames_(static_cast<int>(scene.frames.size())),
      frame_pair_of_pair_(pairs.size()) {
  std::vector<std::tuple<int, int, size_t>> order;
  order.reserve(pairs.size());
  for (size_t i = 0; i < pairs.size(); ++i) {
    const MatchedImages& pair = pairs[i];
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
      !IsSequence(LinksOfRigs(frame_pairs_, pairs, order_of_frames),
                  num_frames_)) {
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

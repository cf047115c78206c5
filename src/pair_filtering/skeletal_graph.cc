// SPDX-License-Identifier: BSD-3-Clause
#include "mgsfm/pair_filtering/skeletal_graph.h"

#include <algorithm>
#include <cstddef>
#include <cstdlib>
#include <tuple>
#include <utility>

#include "math/union_find.h"
#include "mgsfm/base/error.h"
#include "mgsfm/base/mask.h"
#include "pair_filtering/triplet_consistency.h"

namespace mgsfm {
namespace {

constexpr int kMaxFrameGap = 3;
constexpr int kMaxGapOfVehicles = 10;  // between stretches of frames

class SkeletalGraphSelector {
 public:
  SkeletalGraphSelector(const Scene& scene, const ViewGraph& view_graph,
                        const Mask& pair_is_used,
                        const SkeletalGraphOptions& options, int num_threads)
      : scene_(scene),
        view_graph_(view_graph),
        is_used_(pair_is_used),
        options_(options),
        num_threads_(num_threads),
        strengths_(view_graph.pairs.size(), 0.0),
        is_selected_(view_graph.pairs.size(), false),
        parts_(scene.frames.size()) {}

  // First by what is confirmed. The rest only joins what that leaves apart.
  Mask Run() {
    SelectInsideFrames();
    SelectBetweenFrames(
        CountTripletConsistentMatches(view_graph_, is_used_, num_threads_));
    SelectBetweenFrames(CountMatches());
    return std::move(is_selected_);
  }

 private:
  int Frame1(size_t i) const {
    return scene_.images[view_graph_.pairs[i].image_idx1].frame_idx;
  }
  int Frame2(size_t i) const {
    return scene_.images[view_graph_.pairs[i].image_idx2].frame_idx;
  }
  bool IsBetweenFrames(size_t i) const { return Frame1(i) != Frame2(i); }
  std::pair<int, int> Frames(size_t i) const {
    return std::minmax(Frame1(i), Frame2(i));
  }
  bool LeavesPart(size_t i) {
    return is_used_[i] && parts_.Find(Frame1(i)) != parts_.Find(Frame2(i));
  }
  void Select(size_t i) {
    is_selected_[i] = true;
    parts_.Union(Frame1(i), Frame2(i));
  }

  std::vector<int> CountMatches() const {
    std::vector<int> num_matches;
    for (const ImagePair& pair : view_graph_.pairs) {
      num_matches.push_back(std::max(1, static_cast<int>(pair.matches.size())));
    }
    return num_matches;
  }

  void SelectInsideFrames() {
    for (size_t i = 0; i < is_selected_.size(); ++i) {
      if (is_used_[i] && !IsBetweenFrames(i)) is_selected_[i] = true;
    }
  }

  void SelectBetweenFrames(const std::vector<int>& num_matches) {
    ComputeStrengths(num_matches);
    std::vector<size_t> strong;
    for (size_t i = 0; i < is_selected_.size(); ++i) {
      if (LeavesPart(i) && strengths_[i] > options_.min_strength) {
        strong.push_back(i);
      }
    }
    for (const size_t i : strong) Select(i);
    while (ConnectParts()) {
    }
  }

  // All pairs of two frames have the strength of the frames, but those without
  // a match have none.
  void ComputeStrengths(const std::vector<int>& num_matches_of_pair) {
    using FramePair = std::pair<int, int>;
    std::vector<std::pair<FramePair, size_t>> order;  // pairs, by frames
    for (size_t i = 0; i < strengths_.size(); ++i) {
      if (is_used_[i] && IsBetweenFrames(i)) order.emplace_back(Frames(i), i);
    }
    std::sort(order.begin(), order.end());
    std::vector<int> most(scene_.frames.size(), 1);
    std::vector<int> num_matches(strengths_.size(), 0);  // of the frames
    for (size_t begin = 0, end = 0; begin < order.size(); begin = end) {
      int num = 0;
      for (; end < order.size() && order[end].first == order[begin].first;
           ++end) {
        num += num_matches_of_pair[order[end].second];
      }
      for (size_t k = begin; k < end; ++k) num_matches[order[k].second] = num;
      const auto [frame1, frame2] = order[begin].first;
      most[frame1] = std::max(most[frame1], num);
      most[frame2] = std::max(most[frame2], num);
    }
    for (const auto& [frames, i] : order) {
      const int best = std::min(most[frames.first], most[frames.second]);
      strengths_[i] = num_matches_of_pair[i] == 0
                          ? 0.0
                          : static_cast<double>(num_matches[i]) / best;
    }
  }

  // False if no pair with any strength leaves its part.
  bool ConnectParts() {
    std::vector<double> strongest(parts_.size(), 0.0);  // by representative
    for (size_t i = 0; i < strengths_.size(); ++i) {
      if (!LeavesPart(i)) continue;
      for (const int frame : {Frame1(i), Frame2(i)}) {
        double& most = strongest[parts_.Find(frame)];
        most = std::max(most, strengths_[i]);
      }
    }
    std::vector<size_t> connecting;
    for (size_t i = 0; i < strengths_.size(); ++i) {
      if (LeavesPart(i) && strengths_[i] > 0.0 &&
          strengths_[i] >= options_.min_connecting_strength *
                               std::min(strongest[parts_.Find(Frame1(i))],
                                        strongest[parts_.Find(Frame2(i))])) {
        connecting.push_back(i);
      }
    }
    for (const size_t i : connecting) Select(i);
    return !connecting.empty();
  }

  const Scene& scene_;
  const ViewGraph& view_graph_;
  const Mask& is_used_;
  const SkeletalGraphOptions& options_;
  const int num_threads_;
  std::vector<double> strengths_;
  Mask is_selected_;
  UnionFind parts_;  // of frames
};

}  // namespace

Mask SelectSkeletalGraph(const Scene& scene, const ViewGraph& view_graph,
                         const Mask& pair_is_used,
                         const SkeletalGraphOptions& options, int num_threads) {
  MGSFM_CHECK_EQ(pair_is_used.size(), view_graph.pairs.size());
  return SkeletalGraphSelector(scene, view_graph, pair_is_used, options,
                               num_threads)
      .Run();
}

std::vector<RejectedGroup> GroupRejectedPairs(const Scene& scene,
                                              const ViewGraph& view_graph,
                                              const Mask& pair_is_rejected) {
  MGSFM_CHECK_EQ(pair_is_rejected.size(), view_graph.pairs.size());
  std::vector<std::pair<int, int>> frames;  // low, high
  for (size_t i = 0; i < view_graph.pairs.size(); ++i) {
    if (!pair_is_rejected[i]) continue;
    const ImagePair& pair = view_graph.pairs[i];
    frames.push_back(std::minmax({scene.images[pair.image_idx1].frame_idx,
                                  scene.images[pair.image_idx2].frame_idx}));
  }
  std::sort(frames.begin(), frames.end());
  UnionFind sets(frames.size());
  for (size_t i = 0; i < frames.size(); ++i) {
    for (size_t k = i + 1;
         k < frames.size() && frames[k].first - frames[i].first <= kMaxFrameGap;
         ++k) {
      if (std::abs(frames[k].second - frames[i].second) <= kMaxFrameGap) {
        sets.Union(i, k);
      }
    }
  }
  std::vector<RejectedGroup> group_of_set(frames.size());
  for (size_t i = 0; i < frames.size(); ++i) {
    RejectedGroup& group = group_of_set[sets.Find(i)];
    const auto [low, high] = frames[i];
    if (group.num_pairs++ == 0) group = {1, low, low, high, high};
    group.first_frame_idx1 = std::min(group.first_frame_idx1, low);
    group.last_frame_idx1 = std::max(group.last_frame_idx1, low);
    group.first_frame_idx2 = std::min(group.first_frame_idx2, high);
    group.last_frame_idx2 = std::max(group.last_frame_idx2, high);
  }
  std::vector<RejectedGroup> groups;
  for (const RejectedGroup& group : group_of_set) {
    if (group.num_pairs > 0) groups.push_back(group);
  }
  std::sort(groups.begin(), groups.end(),
            [](const RejectedGroup& a, const RejectedGroup& b) {
              return std::tuple(-a.num_pairs, a.first_frame_idx1,
                                a.first_frame_idx2) <
                     std::tuple(-b.num_pairs, b.first_frame_idx1,
                                b.first_frame_idx2);
            });
  return groups;
}

std::string DescribeRejectedGroup(const Scene& scene,
                                  const RejectedGroup& group) {
  const auto name = [&](int frame_idx) {
    return "'" + scene.frames[frame_idx].name + "'";
  };
  const bool is_near =
      group.first_frame_idx2 - group.last_frame_idx1 <= kMaxGapOfVehicles;
  return std::to_string(group.num_pairs) + " pairs between frames " +
         name(group.first_frame_idx1) + " to " + name(group.last_frame_idx1) +
         " and " + name(group.first_frame_idx2) + " to " +
         name(group.last_frame_idx2) +
         " contradict all others and are left out; perhaps they show " +
         (is_near ? "vehicles that move along"
                  : "two structures that look alike");
}

}  // namespace mgsfm

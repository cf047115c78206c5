// SPDX-License-Identifier: BSD-3-Clause
#include "pair_filtering/unsupported_bridges.h"

#include <algorithm>
#include <cstddef>
#include <utility>

#include "mgsfm/base/mask.h"
#include "pair_filtering/triplet_consistency.h"

namespace mgsfm {
namespace {

constexpr double kMinShareAgainst = 0.5;

// All consistent pairs of two frames.
struct Link {
  int frame_idx1 = 0;
  int frame_idx2 = 0;
  int num_matches = 0;
  int num_triplet_consistent = 0;
  std::vector<size_t> pair_idxs;

  int Other(int frame_idx) const {
    return frame_idx == frame_idx1 ? frame_idx2 : frame_idx1;
  }
};

class BridgeFinder {
 public:
  BridgeFinder(const Scene& scene, const ViewGraph& view_graph,
               const Mask& pair_is_consistent, int num_threads)
      : scene_(scene),
        view_graph_(view_graph),
        is_consistent_(pair_is_consistent),
        num_threads_(num_threads),
        links_of_frame_(scene.frames.size()),
        nodes_(scene.frames.size()) {}

  Mask Run() {
    CollectLinks();
    for (size_t f = 0; f < nodes_.size(); ++f) {
      if (nodes_[f].enter < 0) Walk(static_cast<int>(f));
    }
    Mask is_unsupported(view_graph_.pairs.size(), false);
    if (std::none_of(nodes_.begin(), nodes_.end(), IsBelowBridge)) {
      return is_unsupported;
    }
    CountTripletConsistent();
    for (size_t f = 0; f < nodes_.size(); ++f) {
      if (!IsBelowLoneBridge(f)) continue;
      const Link& bridge = links_[nodes_[f].link_to_parent];
      if (NumMatchesAgainst(nodes_[f]) <
          kMinShareAgainst * bridge.num_matches) {
        continue;
      }
      for (const size_t i : bridge.pair_idxs) is_unsupported[i] = true;
    }
    return is_unsupported;
  }

 private:
  // Of the depth-first walk. The frames below one are those that are entered
  // from its enter to before its leave.
  struct Node {
    int root = -1;
    int link_to_parent = -1;
    int enter = -1;
    int leave = -1;
    int lowest = -1;  // first entered that is linked with one below
  };

  int FrameOf(int image_idx) const {
    return scene_.images[image_idx].frame_idx;
  }
  std::pair<int, int> FramesOf(size_t pair_idx) const {
    return std::minmax(FrameOf(view_graph_.pairs[pair_idx].image_idx1),
                       FrameOf(view_graph_.pairs[pair_idx].image_idx2));
  }

  void CollectLinks() {
    std::vector<std::pair<std::pair<int, int>, size_t>> order;
    for (size_t i = 0; i < view_graph_.pairs.size(); ++i) {
      const std::pair<int, int> frames = FramesOf(i);
      if (is_consistent_[i] && frames.first != frames.second) {
        order.emplace_back(frames, i);
      }
    }
    std::sort(order.begin(), order.end());
    for (const auto& [frames, i] : order) {
      if (links_.empty() || links_.back().frame_idx1 != frames.first ||
          links_.back().frame_idx2 != frames.second) {
        links_of_frame_[frames.first].push_back(links_.size());
        links_of_frame_[frames.second].push_back(links_.size());
        links_.push_back({frames.first, frames.second, 0, 0, {}});
      }
      Link& link = links_.back();
      link.num_matches += static_cast<int>(view_graph_.pairs[i].matches.size());
      link.pair_idxs.push_back(i);
    }
  }

  void CountTripletConsistent() {
    const std::vector<int> num_triplet_consistent =
        CountTripletConsistentMatches(view_graph_, is_consistent_,
                                      num_threads_);
    for (Link& link : links_) {
      for (const size_t i : link.pair_idxs) {
        link.num_triplet_consistent += num_triplet_consistent[i];
      }
    }
  }

  void Enter(int frame_idx, int root, int link_to_parent) {
    nodes_[frame_idx] = {root, link_to_parent, num_entered_, -1, num_entered_};
    ++num_entered_;
    path_.emplace_back(frame_idx, 0);
  }

  // Depth first, without recursion: paths are as long as drives.
  void Walk(int root) {
    Enter(root, root, -1);
    while (!path_.empty()) {
      const int f = path_.back().first;
      Node& node = nodes_[f];
      if (path_.back().second == links_of_frame_[f].size()) {
        node.leave = num_entered_;
        path_.pop_back();
        if (path_.empty()) continue;
        int& lowest = nodes_[path_.back().first].lowest;
        lowest = std::min(lowest, node.lowest);
        continue;
      }
      const auto link =
          static_cast<int>(links_of_frame_[f][path_.back().second++]);
      if (link == node.link_to_parent) continue;
      const int other = links_[link].Other(f);
      if (nodes_[other].enter < 0) {
        Enter(other, root, link);
      } else {
        node.lowest = std::min(node.lowest, nodes_[other].enter);
      }
    }
  }

  bool HasTripletConsistentLink(int frame_idx) const {
    const auto& links = links_of_frame_[frame_idx];
    return std::any_of(links.begin(), links.end(), [&](size_t link) {
      return links_[link].num_triplet_consistent > 0;
    });
  }

  static bool IsBelowBridge(const Node& node) {
    return node.link_to_parent >= 0 && node.lowest >= node.enter;
  }

  bool IsBelowLoneBridge(size_t frame_idx) const {
    const Node& node = nodes_[frame_idx];
    if (!IsBelowBridge(node)) return false;
    const Link& bridge = links_[node.link_to_parent];
    return bridge.num_triplet_consistent == 0 &&
           (HasTripletConsistentLink(bridge.frame_idx1) ||
            HasTripletConsistentLink(bridge.frame_idx2));
  }

  // Of pairs from the frames below to the others of the part.
  int NumMatchesAgainst(const Node& top) const {
    const auto is_below = [&](int frame_idx) {
      return nodes_[frame_idx].enter >= top.enter &&
             nodes_[frame_idx].enter < top.leave;
    };
    int num = 0;
    for (size_t i = 0; i < view_graph_.pairs.size(); ++i) {
      if (is_consistent_[i] || !view_graph_.pairs[i].relative_pose) continue;
      const auto [f, g] = FramesOf(i);
      if (nodes_[f].root != top.root || nodes_[g].root != top.root) continue;
      if (is_below(f) != is_below(g)) {
        num += static_cast<int>(view_graph_.pairs[i].matches.size());
      }
    }
    return num;
  }

  const Scene& scene_;
  const ViewGraph& view_graph_;
  const Mask& is_consistent_;
  const int num_threads_;
  std::vector<Link> links_;
  std::vector<std::vector<size_t>> links_of_frame_;
  std::vector<Node> nodes_;                   // per frame
  std::vector<std::pair<int, size_t>> path_;  // frame, its next link
  int num_entered_ = 0;
};

}  // namespace

Mask FindUnsupportedBridges(const Scene& scene, const ViewGraph& view_graph,
                            const Mask& pair_is_consistent, int num_threads) {
  return BridgeFinder(scene, view_graph, pair_is_consistent, num_threads).Run();
}

}  // namespace mgsfm

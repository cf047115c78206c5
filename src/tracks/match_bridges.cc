// SPDX-License-Identifier: BSD-3-Clause
#include "tracks/match_bridges.h"

#include <algorithm>
#include <numeric>
#include <vector>

namespace mgsfm::internal {
namespace {

constexpr uint32_t kNone = UINT32_MAX;

// The used matches at each keypoint, in flat arrays.
struct MatchAdjacency {
  struct Link {
    uint32_t node;
    uint32_t match;  // position among the matches of all pairs
  };
  std::vector<uint32_t> offsets;
  std::vector<Link> links;
};

MatchAdjacency MakeAdjacency(const KeypointNodes& nodes,
                             const ViewGraph& view_graph,
                             const MatchSelection& selection) {
  MatchAdjacency adjacency;
  adjacency.offsets.assign(nodes.size() + 1, 0);
  ForEachMatch(nodes, view_graph, selection, [&](const UsedMatch& match) {
    ++adjacency.offsets[match.node1 + 1];
    ++adjacency.offsets[match.node2 + 1];
  });
  std::partial_sum(adjacency.offsets.begin(), adjacency.offsets.end(),
                   adjacency.offsets.begin());
  adjacency.links.resize(adjacency.offsets.back());
  std::vector<uint32_t> next(adjacency.offsets.begin(),
                             adjacency.offsets.end() - 1);
  ForEachMatch(nodes, view_graph, selection, [&](const UsedMatch& match) {
    adjacency.links[next[match.node1]++] = {match.node2, match.position};
    adjacency.links[next[match.node2]++] = {match.node1, match.position};
  });
  return adjacency;
}

// Depth-first over one component after the other.
class BridgeSearch {
 public:
  explicit BridgeSearch(const MatchAdjacency& adjacency)
      : adjacency_(adjacency),
        next_(adjacency.offsets.begin(), adjacency.offsets.end() - 1),
        number_(next_.size(), kNone),
        lowest_(next_.size()),
        match_to_parent_(next_.size()) {}

  // Calls function(match) for each bridge.
  template <class Function>
  void ForEachBridge(const Function& function) {
    for (uint32_t root = 0; root < number_.size(); ++root) {
      if (number_[root] == kNone) VisitComponent(root, function);
    }
  }

 private:
  void Enter(uint32_t node, uint32_t match) {
    number_[node] = lowest_[node] = num_visited_++;
    match_to_parent_[node] = match;
    path_.push_back(node);
  }

  // `lowest_` becomes the lowest number that what was reached through a node is
  // linked to, by other matches than that to its parent.
  template <class Function>
  void VisitComponent(uint32_t root, const Function& function) {
    Enter(root, kNone);
    while (!path_.empty()) {
      const uint32_t node = path_.back();
      if (next_[node] == adjacency_.offsets[node + 1]) {
        Leave(function);
        continue;
      }
      const MatchAdjacency::Link& link = adjacency_.links[next_[node]++];
      if (link.match == match_to_parent_[node]) continue;
      if (number_[link.node] == kNone) {
        Enter(link.node, link.match);
      } else {
        lowest_[node] = std::min(lowest_[node], number_[link.node]);
      }
    }
  }

  template <class Function>
  void Leave(const Function& function) {
    const uint32_t node = path_.back();
    path_.pop_back();
    if (path_.empty()) return;
    uint32_t& lowest = lowest_[path_.back()];
    lowest = std::min(lowest, lowest_[node]);
    if (lowest_[node] == number_[node]) function(match_to_parent_[node]);
  }

  const MatchAdjacency& adjacency_;
  std::vector<uint32_t> next_;    // per node: link to follow
  std::vector<uint32_t> number_;  // per node, in the order of the search
  std::vector<uint32_t> lowest_, match_to_parent_;
  std::vector<uint32_t> path_;
  uint32_t num_visited_ = 0;
};

}  // namespace

std::vector<char> FindBridges(const KeypointNodes& nodes,
                              const ViewGraph& view_graph,
                              const MatchSelection& selection) {
  std::vector<char> is_bridge(NumMatches(view_graph), false);
  const MatchAdjacency adjacency = MakeAdjacency(nodes, view_graph, selection);
  BridgeSearch(adjacency).ForEachBridge(
      [&](uint32_t match) { is_bridge[match] = true; });
  return is_bridge;
}

}  // namespace mgsfm::internal

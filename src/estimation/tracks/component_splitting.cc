// SPDX-License-Identifier: BSD-3-Clause
#include "tracks/component_splitting.h"

#include <algorithm>
#include <numeric>
#include <tuple>
#include <utility>
#include <vector>

#include "math/sorted_adjacency.h"
#include "mgsfm/base/mask.h"

namespace mgsfm::internal {
namespace {

constexpr uint32_t kNone = MatchComponents::kNone;

// Disjoint sets of nodes with at most one keypoint per image, except for
// features detected twice. Members are linked lists.
class ConflictFreeSets {
 public:
  ConflictFreeSets(const Scene& scene, const Observation* observations,
                   size_t num_nodes, double max_duplicate_distance_px)
      : scene_(scene),
        observations_(observations),
        max_squared_distance_(max_duplicate_distance_px *
                              max_duplicate_distance_px),
        set_of_node_(num_nodes),
        next_(num_nodes, kNone),
        last_(num_nodes),
        size_(num_nodes, 1),
        local_image_(num_nodes, 0) {
    std::iota(set_of_node_.begin(), set_of_node_.end(), 0);
    std::iota(last_.begin(), last_.end(), 0);
    for (size_t i = 1; i < num_nodes; ++i) {
      local_image_[i] = local_image_[i - 1] + (observations[i].image_idx !=
                                               observations[i - 1].image_idx);
    }
    node_in_image_.assign(num_nodes > 0 ? local_image_.back() + 1 : 0, kNone);
  }

  // Joins the sets of both nodes unless this causes a conflict.
  void UnionIfConsistent(uint32_t a, uint32_t b) {
    uint32_t into = set_of_node_[a], from = set_of_node_[b];
    if (into == from) return;
    if (std::make_pair(size_[into], from) < std::make_pair(size_[from], into)) {
      std::swap(into, from);
    }
    if (HaveConflict(into, from)) return;
    for (uint32_t i = from; i != kNone; i = next_[i]) set_of_node_[i] = into;
    next_[last_[into]] = from;
    last_[into] = last_[from];
    size_[into] += size_[from];
  }

  uint32_t SetOf(uint32_t node) const { return set_of_node_[node]; }

 private:
  bool HaveConflict(uint32_t set1, uint32_t set2) {
    for (uint32_t i = set1; i != kNone; i = next_[i]) {
      node_in_image_[local_image_[i]] = i;
    }
    bool have_conflict = false;
    for (uint32_t i = set2; i != kNone && !have_conflict; i = next_[i]) {
      const uint32_t other = node_in_image_[local_image_[i]];
      have_conflict = other != kNone && AreDifferent(i, other);
    }
    for (uint32_t i = set1; i != kNone; i = next_[i]) {
      node_in_image_[local_image_[i]] = kNone;
    }
    return have_conflict;
  }

  bool AreDifferent(uint32_t a, uint32_t b) const {
    const auto& keypoints =
        scene_.images[observations_[a].image_idx].keypoints_px;
    const double squared_distance = (keypoints[observations_[a].keypoint_idx] -
                                     keypoints[observations_[b].keypoint_idx])
                                        .cast<double>()
                                        .squaredNorm();
    return squared_distance > max_squared_distance_;
  }

  const Scene& scene_;
  const Observation* observations_;
  const double max_squared_distance_;
  std::vector<uint32_t> set_of_node_;    // the head of its list
  std::vector<uint32_t> next_;           // in the list of its set
  std::vector<uint32_t> last_, size_;    // of a set, at its head
  std::vector<uint32_t> local_image_;    // image index within the component
  std::vector<uint32_t> node_in_image_;  // scratch, kNone between calls
};

// Indices of the matches in descending order of support.
std::vector<uint32_t> OrderBySupport(const SortedAdjacency& adjacency,
                                     const ComponentMatch* matches,
                                     size_t num_matches) {
  std::vector<uint32_t> support(num_matches), order(num_matches);
  for (size_t i = 0; i < num_matches; ++i) {
    support[i] =
        adjacency.NumCommonNeighbors(matches[i].first, matches[i].second);
  }
  std::iota(order.begin(), order.end(), 0);
  std::sort(order.begin(), order.end(), [&](uint32_t a, uint32_t b) {
    return std::make_tuple(support[b], matches[b].num_pair_matches,
                           matches[a].first, matches[a].second) <
           std::make_tuple(support[a], matches[a].num_pair_matches,
                           matches[b].first, matches[b].second);
  });
  return order;
}

// Whether each node represents its set in its image: it has the most matches
// within the set; ties go to the first node.
Mask ChooseRepresentatives(const Observation* observations, size_t num_nodes,
                           const SortedAdjacency& adjacency,
                           const std::vector<uint32_t>& set_of_node) {
  std::vector<uint32_t> degree(num_nodes, 0);
  for (uint32_t node = 0; node < num_nodes; ++node) {
    for (const uint32_t* i = adjacency.begin(node); i != adjacency.end(node);
         ++i) {
      degree[node] += set_of_node[*i] == set_of_node[node];
    }
  }
  Mask is_kept(num_nodes, true);
  for (uint32_t i = 0; i < num_nodes; ++i) {
    for (uint32_t j = i + 1; j < num_nodes && observations[j].image_idx ==
                                                  observations[i].image_idx;
         ++j) {
      if (set_of_node[i] != set_of_node[j]) continue;
      is_kept[degree[j] > degree[i] ? i : j] = false;
    }
  }
  return is_kept;
}

// The sets with at least two nodes, ordered by their first nodes.
ObservationGroups GroupBySet(const Observation* observations,
                             const std::vector<uint32_t>& set_of_node,
                             const Mask& is_kept) {
  const size_t num_nodes = set_of_node.size();
  std::vector<uint32_t> first_node_of_set(num_nodes, kNone);
  std::vector<std::pair<uint32_t, uint32_t>> order;  // first of set, node
  for (uint32_t node = 0; node < num_nodes; ++node) {
    if (!is_kept[node]) continue;
    uint32_t& first_node = first_node_of_set[set_of_node[node]];
    if (first_node == kNone) first_node = node;
    order.emplace_back(first_node, node);
  }
  std::sort(order.begin(), order.end());
  ObservationGroups groups;
  for (size_t begin = 0, end = 0; begin < order.size(); begin = end) {
    while (end < order.size() && order[end].first == order[begin].first) ++end;
    if (end - begin < 2) continue;
    for (size_t i = begin; i < end; ++i) {
      groups.observations.push_back(observations[order[i].second]);
    }
    groups.FinishGroup();
  }
  return groups;
}

}  // namespace

ObservationGroups SplitComponent(const Scene& scene,
                                 const Observation* observations,
                                 size_t num_observations,
                                 const ComponentMatch* matches,
                                 size_t num_matches,
                                 double max_duplicate_distance_px) {
  const SortedAdjacency adjacency(num_observations, [&](const auto& visit) {
    for (size_t i = 0; i < num_matches; ++i) {
      visit(matches[i].first, matches[i].second);
    }
  });
  ConflictFreeSets sets(scene, observations, num_observations,
                        max_duplicate_distance_px);
  for (const uint32_t i : OrderBySupport(adjacency, matches, num_matches)) {
    sets.UnionIfConsistent(matches[i].first, matches[i].second);
  }
  std::vector<uint32_t> set_of_node(num_observations);
  for (uint32_t node = 0; node < num_observations; ++node) {
    set_of_node[node] = sets.SetOf(node);
  }
  return GroupBySet(observations, set_of_node,
                    ChooseRepresentatives(observations, num_observations,
                                          adjacency, set_of_node));
}

}  // namespace mgsfm::internal

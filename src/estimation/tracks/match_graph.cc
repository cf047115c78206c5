// SPDX-License-Identifier: BSD-3-Clause
#include "tracks/match_graph.h"

#include <algorithm>

#include "math/union_find.h"
#include "mgsfm/base/error.h"

namespace mgsfm {
namespace {

// Calls function(node1, node2, num_pair_matches) for all used matches.
template <class Function>
void ForEachMatch(const KeypointNodes& nodes, const ViewGraph& view_graph,
                  const MatchSelection& selection, const Function& function) {
  const bool has_all_matches = selection.match_is_used.empty();
  size_t next = 0;
  for (size_t i = 0; i < view_graph.pairs.size(); ++i) {
    const ImagePair& pair = view_graph.pairs[i];
    const size_t first = next;
    next += pair.matches.size();
    if (!selection.pair_is_used[i]) continue;
    const uint32_t num_matches = static_cast<uint32_t>(pair.matches.size());
    for (size_t k = first; k < next; ++k) {
      if (!has_all_matches && !selection.match_is_used[k]) continue;
      const Match& match = pair.matches[k - first];
      function(nodes.NodeOf(pair.image_idx1, match.keypoint_idx1),
               nodes.NodeOf(pair.image_idx2, match.keypoint_idx2), num_matches);
    }
  }
}

// Whether two observations of a sorted group are in one image.
bool HasConflict(const ObservationGroups& groups, size_t group) {
  return std::adjacent_find(groups.begin(group), groups.end(group),
                            [](const Observation& a, const Observation& b) {
                              return a.image_idx == b.image_idx;
                            }) != groups.end(group);
}

}  // namespace

KeypointNodes::KeypointNodes(const Scene& scene) {
  size_t num_nodes = 0;
  first_node_.reserve(scene.images.size());
  for (const Image& image : scene.images) {
    first_node_.push_back(static_cast<uint32_t>(num_nodes));
    num_nodes += image.keypoints_px.size();
  }
  MGSFM_CHECK_LT(num_nodes, size_t{UINT32_MAX});
  image_idx_of_node_.reserve(num_nodes);
  for (size_t i = 0; i < scene.images.size(); ++i) {
    image_idx_of_node_.insert(image_idx_of_node_.end(),
                              scene.images[i].keypoints_px.size(),
                              static_cast<int>(i));
  }
}

MatchComponents FindComponents(const KeypointNodes& nodes,
                               const ViewGraph& view_graph,
                               const MatchSelection& selection) {
  UnionFind union_find(nodes.size());
  ForEachMatch(nodes, view_graph, selection,
               [&](uint32_t node1, uint32_t node2, uint32_t) {
                 union_find.Union(node1, node2);
               });
  const uint32_t num_nodes = static_cast<uint32_t>(nodes.size());
  std::vector<uint32_t> root(num_nodes), size_of_root(num_nodes, 0);
  for (uint32_t node = 0; node < num_nodes; ++node) {
    root[node] = static_cast<uint32_t>(union_find.Find(node));
    ++size_of_root[root[node]];
  }

  MatchComponents components;
  components.component_of_node.assign(num_nodes, MatchComponents::kNone);
  components.position_of_node.assign(num_nodes, 0);
  // Nodes are visited in ascending order, so that components are numbered by
  // their first observations and groups are sorted.
  std::vector<uint32_t> component_of_root(num_nodes, MatchComponents::kNone);
  std::vector<uint32_t> num_filled;
  ObservationGroups& groups = components.groups;
  for (uint32_t node = 0; node < num_nodes; ++node) {
    const uint32_t size = size_of_root[root[node]];
    if (size < 2) continue;
    uint32_t& component = component_of_root[root[node]];
    if (component == MatchComponents::kNone) {
      component = static_cast<uint32_t>(num_filled.size());
      num_filled.push_back(0);
      groups.offsets.push_back(groups.offsets.back() + size);
    }
    components.component_of_node[node] = component;
    components.position_of_node[node] = num_filled[component]++;
  }
  groups.observations.resize(groups.offsets.back());
  for (uint32_t node = 0; node < num_nodes; ++node) {
    const uint32_t component = components.component_of_node[node];
    if (component == MatchComponents::kNone) continue;
    groups.observations[groups.offsets[component] +
                        components.position_of_node[node]] =
        nodes.ObservationOf(node);
  }
  components.has_conflict.resize(groups.size());
  for (size_t i = 0; i < groups.size(); ++i) {
    components.has_conflict[i] = HasConflict(groups, i);
  }
  return components;
}

ConflictingMatches GatherConflictingMatches(const KeypointNodes& nodes,
                                            const ViewGraph& view_graph,
                                            const MatchSelection& selection,
                                            const MatchComponents& components) {
  const auto& component_of_node = components.component_of_node;
  const auto& position_of_node = components.position_of_node;
  ConflictingMatches result;
  result.offsets.assign(components.groups.size() + 1, 0);
  ForEachMatch(nodes, view_graph, selection,
               [&](uint32_t node1, uint32_t, uint32_t) {
                 const uint32_t component = component_of_node[node1];
                 if (!components.has_conflict[component]) return;
                 ++result.offsets[component + 1];
               });
  for (size_t i = 1; i < result.offsets.size(); ++i) {
    result.offsets[i] += result.offsets[i - 1];
  }
  result.matches.resize(result.offsets.back());
  std::vector<size_t> next(result.offsets.begin(), result.offsets.end() - 1);
  ForEachMatch(
      nodes, view_graph, selection,
      [&](uint32_t node1, uint32_t node2, uint32_t num_matches) {
        const uint32_t component = component_of_node[node1];
        if (!components.has_conflict[component]) return;
        const auto [first, second] =
            std::minmax(position_of_node[node1], position_of_node[node2]);
        result.matches[next[component]++] = {first, second, num_matches};
      });
  return result;
}

}  // namespace mgsfm

// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <cstddef>
#include <cstdint>
#include <vector>

#include "mgsfm/scene/scene.h"
#include "mgsfm/scene/tracks.h"
#include "mgsfm/scene/view_graph.h"
#include "mgsfm/tracks/match_selection.h"

namespace mgsfm::internal {

// Numbers all keypoints of a scene, image by image: the nodes of the graph of
// matches. Their order is that of observations.
class KeypointNodes {
 public:
  explicit KeypointNodes(const Scene& scene);

  size_t size() const { return image_idx_of_node_.size(); }
  uint32_t NodeOf(int image_idx, uint32_t keypoint_idx) const {
    return first_node_[image_idx] + keypoint_idx;
  }
  Observation ObservationOf(uint32_t node) const {
    const int image_idx = image_idx_of_node_[node];
    return {image_idx, static_cast<int>(node - first_node_[image_idx])};
  }

 private:
  std::vector<uint32_t> first_node_;  // per image
  std::vector<int> image_idx_of_node_;
};

size_t NumMatches(const ViewGraph& view_graph);

struct UsedMatch {
  uint32_t node1, node2;
  uint32_t position;          // among the matches of all pairs
  uint32_t num_pair_matches;  // of the pair of images that it belongs to
};

// Calls function(UsedMatch) for all used matches, pair by pair.
template <class Function>
void ForEachMatch(const KeypointNodes& nodes, const ViewGraph& view_graph,
                  const MatchSelection& selection, const Function& function) {
  const bool has_all_matches = selection.match_is_used.empty();
  uint32_t next = 0;
  for (size_t i = 0; i < view_graph.pairs.size(); ++i) {
    const ImagePair& pair = view_graph.pairs[i];
    const uint32_t num_matches = static_cast<uint32_t>(pair.matches.size());
    const uint32_t first = next;
    next += num_matches;
    if (!selection.pair_is_used[i]) continue;
    for (uint32_t k = 0; k < num_matches; ++k) {
      if (!has_all_matches && !selection.match_is_used[first + k]) continue;
      const Match& match = pair.matches[k];
      function(UsedMatch{nodes.NodeOf(pair.image_idx1, match.keypoint_idx1),
                         nodes.NodeOf(pair.image_idx2, match.keypoint_idx2),
                         first + k, num_matches});
    }
  }
}

// The connected components with at least two nodes.
struct MatchComponents {
  static constexpr uint32_t kNone = UINT32_MAX;

  ObservationGroups groups;
  std::vector<uint32_t> component_of_node;  // kNone for unmatched keypoints
  std::vector<uint32_t> position_of_node;   // in the group of its component
  std::vector<char> has_conflict;           // per component
};

MatchComponents FindComponents(const KeypointNodes& nodes,
                               const ViewGraph& view_graph,
                               const MatchSelection& selection);

// A match within a component, by positions in its group, first < second.
struct ComponentMatch {
  uint32_t first;
  uint32_t second;
  uint32_t num_pair_matches;  // of the pair of images that it belongs to
};

// The matches of the components that have a conflict, in flat arrays: those of
// component c are matches[offsets[c]] to matches[offsets[c + 1] - 1].
struct ConflictingMatches {
  std::vector<ComponentMatch> matches;
  std::vector<size_t> offsets;
};

ConflictingMatches GatherConflictingMatches(const KeypointNodes& nodes,
                                            const ViewGraph& view_graph,
                                            const MatchSelection& selection,
                                            const MatchComponents& components);

}  // namespace mgsfm::internal

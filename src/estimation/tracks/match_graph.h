// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <cstddef>
#include <cstdint>
#include <vector>

#include "mgsfm/base/mask.h"
#include "mgsfm/scene/estimates.h"
#include "mgsfm/scene/scene.h"
#include "mgsfm/scene/view_graph.h"
#include "mgsfm/tracks/track_establishment.h"

namespace mgsfm {

// The nodes of the match graph: all keypoints of a scene, numbered image by
// image, in the order of observations.
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

// The connected components with at least two nodes.
struct MatchComponents {
  // Dense arrays over all keypoints need a plain integer for "none".
  static constexpr uint32_t kNone = UINT32_MAX;

  ObservationGroups groups;
  std::vector<uint32_t> component_of_node;  // kNone for unmatched keypoints
  std::vector<uint32_t> position_of_node;   // within its group
  Mask has_conflict;                        // per component
};

MatchComponents FindComponents(const KeypointNodes& nodes,
                               const ViewGraph& view_graph,
                               const MatchSelection& selection);

// A match within a component, as positions in the group; first < second.
struct ComponentMatch {
  uint32_t first;
  uint32_t second;
  uint32_t num_pair_matches;  // number of matches of its image pair
};

// Matches of the components with conflicts: matches[offsets[c]] to
// matches[offsets[c + 1] - 1] belong to component c.
struct ConflictingMatches {
  std::vector<ComponentMatch> matches;
  std::vector<size_t> offsets;
};

ConflictingMatches GatherConflictingMatches(const KeypointNodes& nodes,
                                            const ViewGraph& view_graph,
                                            const MatchSelection& selection,
                                            const MatchComponents& components);

}  // namespace mgsfm

// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <vector>

#include "mgsfm/base/mask.h"
#include "mgsfm/pair_filtering/pair_filtering.h"
#include "mgsfm/scene/estimates.h"
#include "mgsfm/scene/scene.h"
#include "mgsfm/scene/view_graph.h"
#include "mgsfm/seams/confidence.h"
#include "pair_filtering/frame_pair_index.h"
#include "seams/motion_jumps.h"

namespace mgsfm {

struct ConfidenceInput {
  const Scene& scene;
  const FramePairIndex& index;  // of the view graph
  const ViewGraph& view_graph;
  const Mask& pair_is_used;  // those whose matches made tracks
  const std::vector<RejectedGroup>& rejected_groups;
  const Reconstruction& reconstruction;
  ComparedMotions motions = {};
};

// The points that two frames of each of two sides observe, or the only frame of
// a side. Sides are sorted.
int CountTies(const Scene& scene, const Reconstruction& reconstruction,
              const std::vector<int>& side1, const std::vector<int>& side2);

// See mgsfm/seams/confidence.h. Seams have no standard deviations. Cost:
// linear in matches and observations, times the depth of the tree for pairs of
// distant frames.
Confidence EstimateConfidence(const ConfidenceInput& input,
                              const ConfidenceOptions& options);

}  // namespace mgsfm

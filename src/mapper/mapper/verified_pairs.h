// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <cstddef>
#include <optional>
#include <vector>

#include "mgsfm/base/context.h"
#include "mgsfm/mapper/mapper.h"
#include "mgsfm/scene/estimates.h"
#include "mgsfm/scene/scene.h"
#include "mgsfm/scene/view_graph.h"

namespace mgsfm {

// The rays and image pairs of a scene after verification, for all later stages.
struct VerifiedPairs {
  const Scene& scene;
  const ViewGraph& all_matches;
  Bearings bearings = {};
  ViewGraph view_graph = {};  // relative poses and their inliers
  // The matches outside image regions that are fixed to the rig; nullopt: all
  // matches. Outliers that verify a pair stay outliers here.
  std::optional<ViewGraph> visible_matches = std::nullopt;
  size_t num_of_fixed_regions = 0;  // pairs that only matches there verify

  const ViewGraph& matches() const {
    return visible_matches ? *visible_matches : all_matches;
  }
};

// Verifies all matches, and again without those of fixed regions, until no
// region is new (moving_objects/fixed_regions.h). Adds the summary and the
// times of the stages to the result.
[[nodiscard]] VerifiedPairs VerifyAllPairs(const Scene& scene,
                                           const ViewGraph& matches,
                                           const MapperOptions& options,
                                           const Context& context,
                                           MapperResult* result);

}  // namespace mgsfm

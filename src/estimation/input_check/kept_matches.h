// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <vector>

#include "mgsfm/base/context.h"
#include "mgsfm/input_check/finding.h"
#include "mgsfm/input_check/kept_matches.h"
#include "mgsfm/scene/estimates.h"
#include "mgsfm/scene/scene.h"
#include "mgsfm/scene/view_graph.h"

namespace mgsfm {

// A match agrees if its Sampson error is at most sqrt(2) max_error_px
// (mgsfm/tracks/track_establishment.h). Cost: linear in the number of matches.
KeptMatches CountKeptMatches(const Scene& scene, const ViewGraph& view_graph,
                             const Reconstruction& model, double max_error_px,
                             const Context& context);

// Cameras and segments of frames whose matches the model mostly does not
// explain (kLostMatches).
std::vector<Finding> FindLostMatches(const Scene& scene,
                                     const KeptMatches& kept);

}  // namespace mgsfm

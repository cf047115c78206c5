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

// The share of the observations of a model, but for the first of each point,
// that lie where the first image of the same sensor shows the point. Two
// keypoints of one sensor can belong to one projection if they differ by at
// most twice `max_error_px`, the outlier bound of bundle adjustment. The first
// observations of further sensors count as moving, so that a few points that
// single cameras see do not decide. 0 for a model without such observations.
//
// Cost: linear in the observations, but for the logarithm of the sensors.
[[nodiscard]] double ShareAtRest(const Scene& scene,
                                 const Reconstruction& model,
                                 double max_error_px);

// Whether the rig of a model stands still. Either it did not move, or the
// images show only objects that move along with it; they do not tell which.
inline bool IsAtRest(double share_at_rest) {
  // Models of standing rigs have at least 0.97, others at most 0.08
  // (docs/results/input_check.md). A rig that stands for most of a recording
  // and then moves does not stand still.
  constexpr double kMinShareAtRest = 0.9;
  return share_at_rest >= kMinShareAtRest;
}

}  // namespace mgsfm

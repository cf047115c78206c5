// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <vector>

#include "mgsfm/base/context.h"
#include "mgsfm/base/mask.h"
#include "mgsfm/base/options.h"
#include "mgsfm/scene/estimates.h"
#include "mgsfm/scene/scene.h"
#include "mgsfm/scene/view_graph.h"

namespace mgsfm {

struct MatchSelectionOptions {
  Option<double> min_pair_share{
      "min_pair_share", 0.4, Between(0.0, 1.0),
      "Minimum ratio of the matches between two frames that agree with their "
      "poses; otherwise all of them are rejected. Increase it if structures "
      "repeat."};

  template <class Visitor>
  void Describe(Visitor& visit) {
    visit(min_pair_share);
  }
};

// The used matches of a view graph.
struct MatchSelection {
  Mask pair_is_used;  // per pair
  // Per match, concatenated over all pairs; if empty, all matches of used pairs
  // are used.
  Mask match_is_used;
};

// Selects the matches that agree with the poses of `model`. Two keypoints agree
// if a point in front of both cameras projects to both, with a Sampson error of
// at most sqrt(2) max_error_px, the difference of two keypoints with errors of
// max_error_px (geometry/epipolar.h). Cameras without baseline need rays of the
// same direction.
//
// A few wrong matches agree by chance, and a pair of images of different places
// may have hundreds of matches. As short tracks these pass all tests of single
// points, attract unrelated frames and cause fill-in of the frame system. All
// matches between two frames, over all cameras of the rig, therefore vote
// jointly: none is used if fewer than min_pair_share of them agree.
//
// Pairs without pair_is_used and pairs with an image without pose are not used.
// Cost: linear in the number of matches.
[[nodiscard]] MatchSelection SelectConsistentMatches(
    const Scene& scene, const ViewGraph& view_graph, const Mask& pair_is_used,
    const Reconstruction& model, double max_error_px,
    const MatchSelectionOptions& options, const Context& context);

}  // namespace mgsfm

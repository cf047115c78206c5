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
  double min_pair_share = 0.4;

  template <class Self, class Visitor>
  static void Describe(Self& self, Visitor& visit) {
    visit("min_pair_share", self.min_pair_share, Between(0.0, 1.0), "",
          "Pairs of frames that agree with the poses in a smaller share of "
          "their matches show different places and are left out.");
  }
};

// Which matches of a view graph are used.
struct MatchSelection {
  Mask pair_is_used;  // per pair
  // Per match of all pairs, one pair after the other; empty: all that
  // pair_is_used allows.
  Mask match_is_used;
};

// The matches that the poses of `model` do not contradict. Two keypoints agree
// if some point at a positive distance could show in both: their rays miss each
// other by at most sqrt(2) max_error_px, which is what two keypoints with
// errors of max_error_px differ (epipolar.h; or, where cameras stand at one
// place, they have the same direction).
//
// Of wrong matches a few agree by chance, and a pair of images of different
// places may have a hundred of them: as short tracks they pass every test that
// looks at one point only, pull frames together that have nothing to do with
// each other and fill the factor of the frame system. Hence all matches between
// two frames vote together, for all cameras of the rig, and none is used if
// fewer than min_pair_share of them agree.
//
// Pairs with pair_is_used false or with an image without pose are not used.
// Cost: linear in the matches.
[[nodiscard]] MatchSelection SelectConsistentMatches(
    const Scene& scene, const ViewGraph& view_graph, const Mask& pair_is_used,
    const Reconstruction& model, double max_error_px,
    const MatchSelectionOptions& options, const Context& context);

}  // namespace mgsfm

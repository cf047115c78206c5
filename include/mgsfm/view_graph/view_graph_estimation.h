// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include "mgsfm/base/context.h"
#include "mgsfm/base/options.h"
#include "mgsfm/scene/scene.h"
#include "mgsfm/scene/view_graph.h"

namespace mgsfm {

struct ViewGraphOptions {
  int min_num_inliers = 15;
  double max_error_px = 2.0;

  template <class Self, class Visitor>
  static void Describe(Self& self, Visitor& visit) {
    visit("min_num_inliers", self.min_num_inliers, AtLeast(5), "matches",
          "Pairs with fewer matches that agree with their relative pose are "
          "dropped.");
    visit("max_error_px", self.max_error_px, GreaterThan(0.0), "px",
          "Matches farther from their epipolar geometry are dropped.");
  }
};

struct ViewGraphSummary {
  int num_pairs = 0;        // given
  int num_from_row = 0;     // relative pose taken from the row
  int num_decomposed = 0;   // from E, F or H
  int num_reestimated = 0;  // no usable geometry in the row
  int num_dropped_few_inliers = 0;
  int num_dropped_config = 0;  // DEGENERATE or WATERMARK
};

struct ViewGraphResult {
  ViewGraph estimate;  // kept pairs: relative_pose set, matches are inliers
  ViewGraphSummary summary;
};

[[nodiscard]] ViewGraphResult EstimateViewGraph(const Scene& scene,
                                                const Bearings& bearings,
                                                const ViewGraph& view_graph,
                                                const ViewGraphOptions& options,
                                                const Context& context);

}  // namespace mgsfm

// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <optional>
#include <string>
#include <vector>

#include "mgsfm/base/context.h"
#include "mgsfm/base/options.h"
#include "mgsfm/base/summary.h"
#include "mgsfm/scene/estimates.h"
#include "mgsfm/scene/scene.h"
#include "mgsfm/scene/view_graph.h"

namespace mgsfm {

struct RotationAveragingOptions {
  double max_error_deg = 10.0;

  template <class Self, class Visitor>
  static void Describe(Self& self, Visitor& visit) {
    visit("max_error_deg", self.max_error_deg, Between(0.0, 180.0), "deg",
          "Pairs whose relative rotation differs more are dropped.");
  }
};

// What is known of the internal rotation of one sensor.
struct InternalRotationSummary {
  int num_samples = 0;                         // frames that gave one
  std::optional<double> median_deviation_deg;  // of the samples
  bool is_observable = false;
  std::string message;  // why not, in words
};

struct RotationSummary {
  std::vector<InternalRotationSummary> sensors;  // per sensor
  SolveSummary images;                           // single-image averaging
  SolveSummary frames;                           // rigid-unit averaging
  SolveSummary joint;                            // joint refinement
  int num_pairs_dropped = 0;
};

struct RotationResult {
  RotationEstimate estimate;
  RotationSummary summary;
};

[[nodiscard]] RotationResult AverageRotations(
    const Scene& scene, const ViewGraph& view_graph,
    const RotationAveragingOptions& options, const Context& context);

}  // namespace mgsfm

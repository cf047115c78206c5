// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <string>
#include <vector>

#include "mgsfm/base/context.h"
#include "mgsfm/base/options.h"
#include "mgsfm/base/summary.h"
#include "mgsfm/scene/estimates.h"
#include "mgsfm/scene/scene.h"
#include "mgsfm/scene/tracks.h"
#include "mgsfm/scene/view_graph.h"

namespace mgsfm {

struct TranslationAveragingOptions {
  double min_parallax_deg = 0.3;

  template <class Self, class Visitor>
  static void Describe(Self& self, Visitor& visit) {
    visit("min_parallax_deg", self.min_parallax_deg, Between(0.0, 60.0), "deg",
          "Matches with less parallax do not vote on relative translations.");
  }
};

// What is known of the internal translation of one sensor.
struct InternalTranslationSummary {
  bool is_observable = true;
  std::string message;  // which directions were not observable, and why
};

struct TranslationSummary {
  std::vector<InternalTranslationSummary> sensors;
  SolveSummary initialization;     // L1, ADMM
  SolveSummary camera_refinement;  // angles, cameras only
  SolveSummary joint_refinement;   // angles, cameras and points
  int num_pairs_used = 0;
  int num_pairs_without_parallax = 0;
  size_t num_points = 0;
};

struct TranslationResult {
  PositionEstimate estimate;
  TranslationSummary summary;
};

// All frames with a rotation must be in one connected part.
[[nodiscard]] TranslationResult AverageTranslations(
    const Scene& scene, const Bearings& bearings, const ViewGraph& view_graph,
    const RotationEstimate& rotations, const ObservationGroups& tracks,
    const TranslationAveragingOptions& options, const Context& context);

}  // namespace mgsfm

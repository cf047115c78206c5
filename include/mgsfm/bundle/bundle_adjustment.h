// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include "mgsfm/base/context.h"
#include "mgsfm/base/options.h"
#include "mgsfm/base/summary.h"
#include "mgsfm/scene/estimates.h"
#include "mgsfm/scene/scene.h"
#include "mgsfm/scene/tracks.h"

namespace mgsfm {

struct BundleAdjustmentOptions {
  int max_num_iterations = 100;

  template <class Self, class Visitor>
  static void Describe(Self& self, Visitor& visit) {
    visit("max_num_iterations", self.max_num_iterations, AtLeast(1),
          "iterations", "Most iterations of one solve.");
  }
};

struct BundleSummary {
  std::vector<SolveSummary> solves;
};

struct BundleResult {
  Reconstruction estimate;
  BundleSummary summary;
};

// One solve: reprojection error over poses, points and intrinsics.
[[nodiscard]] BundleResult AdjustBundle(const Scene& scene,
                                        const Reconstruction& initial,
                                        const BundleAdjustmentOptions& options,
                                        const Context& context);

// The whole stage: solves with filters, completion and re-triangulation of the
// groups in `components` between them.
[[nodiscard]] BundleResult RefineReconstruction(
    const Scene& scene, const ObservationGroups& components,
    const Reconstruction& initial, const BundleAdjustmentOptions& options,
    const Context& context);

}  // namespace mgsfm

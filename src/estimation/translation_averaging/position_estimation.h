// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <Eigen/Geometry>
#include <functional>
#include <optional>
#include <vector>

#include "mgsfm/base/context.h"
#include "mgsfm/base/mask.h"
#include "mgsfm/pair_filtering/pair_filtering.h"
#include "mgsfm/scene/estimates.h"
#include "mgsfm/scene/scene.h"
#include "mgsfm/scene/view_graph.h"
#include "mgsfm/translation_averaging/translation_averaging.h"
#include "pair_filtering/frame_pair_index.h"
#include "translation_averaging/translation_stages.h"

namespace mgsfm {

// Positions and points of one connected component from its rotations, by
// AverageTranslations() (mgsfm/translation_averaging/translation_averaging.h).
// Rules of pair_filtering select pairs between its stages, because duplicate
// structures agree with each other and robust averaging alone cannot outvote
// them:
//
//   1           directions and relative lengths of all baselines
//   skeleton    L1 positions by the skeletal graph
//   2           for each drift bound, largest first: L1 positions by the
//               baselines within the bound, until they violate no skeleton
//               edge; the positions with the fewest violations are kept
//   3           angles of these baselines
//   select      baselines that agree with the positions
//   4, 5        triangulation and joint refinement, twice
//   judge       which of all pairs contradict the final positions
//
// If steps of a sequence are displaced (pair_filtering/displaced_steps.h), the
// rotations have drifted. A pose graph (translation_averaging/pose_graph.h)
// corrects them, and all steps are repeated: at most three times, as long as
// this reduces the displacement, places as many frames and turns no step
// (pair_filtering/displaced_steps.h).

struct PositionInput {
  const Scene& scene;
  const Bearings& bearings;
  const ViewGraph& view_graph;
  const FramePairIndex& index;  // of the view graph
  const RotationEstimate& rotations;
  const ObservationGroups& tracks;
  // cam2_from_cam1 of pairs from the motion of the rig (moving_objects.h), in
  // one unit of length; null or empty: unknown.
  const std::vector<std::optional<Rigid3>>* pair_on_path = nullptr;
  // Called with positions as they improve, and points that these triangulate;
  // may be null.
  std::function<void(const PositionEstimate&)> observer = {};
};

struct PositionOptions {
  TranslationAveragingOptions averaging;
  PairFilteringOptions filtering;
};

struct PositionResult {
  PositionEstimate estimate;
  TranslationSummary summary;
  // Per pair of the view graph: whether its measured baseline contradicts the
  // estimate, and whether it also contradicts the skeleton beyond the drift
  // bound.
  Mask pair_is_inconsistent;
  Mask pair_is_beyond_drift_bound;
  // Sum of the deviations of displaced steps, in the unit of measured lengths.
  double displacement = 0.0;
  // Per frame: the rotations of the estimate, if not those of the input.
  std::optional<std::vector<std::optional<Eigen::Quaterniond>>>
      corrected_rig_from_world = std::nullopt;
};

// All frames with a rotation must be in one connected component. Uses the pairs
// with rotations.pair_is_inlier.
[[nodiscard]] PositionResult EstimatePositions(const PositionInput& input,
                                               const PositionOptions& options,
                                               const Context& context);

// The same without a pose graph, for another objective. If it does not refine
// positions, L1 positions are computed to a tighter tolerance.
[[nodiscard]] PositionResult EstimatePositionsBy(
    const PositionObjective& objective, const PositionInput& input,
    const PositionOptions& options, const Context& context);

}  // namespace mgsfm

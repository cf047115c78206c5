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
#include "mgsfm/translation/translation_averaging.h"
#include "pair_filtering/frame_pair_index.h"
#include "translation/position_initialization.h"
#include "translation/position_problem.h"
#include "translation/refinement_terms.h"
#include "translation/track_points.h"
#include "translation/translation_stages.h"

namespace mgsfm {

// Positions and points of one connected component from its rotations. Filtering
// and averaging alternate, because duplicate structures agree among themselves
// and robust averaging alone cannot outvote them:
//
//   measure     directions and relative lengths of all baselines
//   skeleton    L1 positions by the skeletal graph
//   screen      for each drift bound, largest first: L1 positions by the
//               baselines within the bound, until they violate no skeleton
//               edge; the positions with the fewest violations are kept
//   refine      angles of the screened baselines; then those that contradict
//               the positions are rejected, too
//   tracks      triangulation and joint refinement, twice
//   normalise   to the measured lengths, unless known sensor offsets determine
//               the unit of length
//   judge       which of all pairs contradict the final positions
//
// If steps of a sequence are displaced (pair_filtering/displaced_steps.h), the
// rotations have drifted. A pose graph (translation/pose_graph.h) corrects
// them, and all steps are repeated: at most three times, as long as that
// reduces the displacement, places as many frames and turns no step
// (pair_filtering/turned_steps.h).
//
// The stages are those of translation/translation_stages.h, the rules those of
// pair_filtering. The measurements by a set of rotations stay constant; each
// step passes on a mask of the pairs to use.

struct PositionInput {
  const Scene& scene;
  const Bearings& bearings;
  const ViewGraph& view_graph;
  const FramePairIndex& index;  // of the view graph
  const RotationEstimate& rotations;
  const ObservationGroups& tracks;
  // Lengths of the baselines of pairs, by the motion of the rig.
  LengthHints length_hints = {};
  // Sees positions without points as they become better; may be null.
  std::function<void(const PositionEstimate&)> observer = {};
};

struct PositionOptions {
  TranslationAveragingOptions averaging;
  PairFilteringOptions filtering;
};

struct PositionResult {
  PositionEstimate estimate;
  TranslationSummary summary;
  // Per pair of the view graph: its measured baseline contradicts the estimate.
  Mask pair_is_inconsistent;
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

// The steps of the recipe, for methods that replace one of them.

// Everything that is measured before positions are known.
struct PositionMeasurements {
  PositionProblem problem;
  TrackRays rays;
  PairMeasurements pairs;
};
PositionMeasurements MeasurePositions(const PositionInput& input,
                                      const PositionOptions& options,
                                      const Context& context);

// L1 positions and the pairs that they use.
struct ScreenedPositions {
  InitialPositions initial;
  Mask pair_is_used;
};
// The steps "skeleton" and "screen". `initialization` holds for the positions
// that are returned.
ScreenedPositions ScreenAndInitialize(
    const PositionInput& input, const PositionMeasurements& measured,
    const PositionOptions& options, const InitializationOptions& initialization,
    const Context& context);

// The used pairs without those that contradict the positions.
Mask KeepConsistentPairs(const PositionInput& input,
                         const PositionMeasurements& measured,
                         const ScreenedPositions& screened,
                         const Positions& positions,
                         const PairFilteringOptions& options);

// The steps "normalise" and "judge". All pairs are judged, also those rejected
// before: the final positions may agree with them.
PositionResult ConcludePositions(const PositionInput& input,
                                 const PositionMeasurements& measured,
                                 const RefinementInput& refinement,
                                 Positions positions, TrackPoints points,
                                 TranslationSummary summary,
                                 const PairFilteringOptions& options);

}  // namespace mgsfm

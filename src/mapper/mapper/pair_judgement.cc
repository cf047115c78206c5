// SPDX-License-Identifier: BSD-3-Clause
#include "mapper/pair_judgement.h"

#include <algorithm>
#include <cstddef>
#include <utility>

#include "base/ranges.h"
#include "mapper/components.h"
#include "mapper/stage.h"
#include "math/union_find.h"
#include "mgsfm/base/mask.h"
#include "mgsfm/tracks/track_establishment.h"
#include "translation_averaging/position_estimation.h"

namespace mgsfm {
namespace {

// Duplicate structures join places that time separates.
bool HasLoops(const FramePairIndex& index, const PairVerdicts& verdicts) {
  if (!index.is_sequence()) return true;
  for (size_t i = 0; i < verdicts.size(); ++i) {
    if (!verdicts[i] && index.IsLoop(index.Of(i))) return true;
  }
  return false;
}

bool IsAnyRuleOn(const PairFilteringOptions& options) {
  return IsRuleOn(RejectionReason::kBaselineBeyondDriftBound, options) ||
         IsRuleOn(RejectionReason::kInconsistentBaseline, options);
}

// Pairs of images of the model, with the most matches of its points, that
// connect what these connect.
Mask SpanningForest(const MapperRunInput& run, const Reconstruction& model) {
  const std::vector<ImagePair>& pairs = run.matches.pairs;
  const std::vector<std::ptrdiff_t> num_matches =
      CountMatchesOfPoints(run.scene, run.matches, model.points);
  std::vector<size_t> order;
  for (size_t i = 0; i < pairs.size(); ++i) {
    if (num_matches[i] > 0) order.push_back(i);
  }
  StableSortDescendingBy(&order, [&](size_t i) { return num_matches[i]; });
  UnionFind connected(run.scene.images.size());
  Mask is_in_forest(pairs.size());
  for (const size_t i : order) {
    is_in_forest[i] = connected.Union(pairs[i].image_idx1, pairs[i].image_idx2);
  }
  return is_in_forest;
}

}  // namespace

void RejectByPositions(const MapperRunInput& run, const VerifiedPairs& pairs,
                       const FramePairIndex& index, JudgedPairs* judged,
                       std::vector<StageTime>* times) {
  PairVerdicts& verdicts = judged->rotations.verdicts;
  const RotationEstimate& rotations = judged->rotations.estimate;
  if (!HasLoops(index, verdicts) || !IsAnyRuleOn(run.options.pair_filtering)) {
    return;
  }
  const RunningStage stage("translation averaging", run.context);
  PositionObjective objective = kNonBilinearObjective;
  objective.refine_cameras_and_points = nullptr;
  const std::vector<int> num_frames = CountFramesOfComponents(rotations);
  for (size_t k = 0; k < num_frames.size(); ++k) {
    if (num_frames[k] < run.options.min_num_frames) continue;
    const PositionResult positions = EstimatePositionsBy(
        objective,
        {run.scene, pairs.bearings, pairs.view_graph, index,
         SelectComponent(pairs, rotations, static_cast<int>(k)),
         ObservationGroups(), &judged->motion.pair_on_path},
        {run.options.translation_averaging, run.options.pair_filtering},
        stage.context());
    Reject(positions.pair_is_beyond_drift_bound,
           RejectionReason::kBaselineBeyondDriftBound, &verdicts);
    Reject(positions.pair_is_inconsistent,
           RejectionReason::kInconsistentBaseline, &verdicts);
  }
  stage.Finish(times);
}

std::optional<ViewGraph> PairsOfNewImages(const MapperRunInput& run) {
  const auto& model = run.input.existing_model;
  if (!model || model->points.empty()) return std::nullopt;
  Mask is_new(run.scene.images.size());
  for (size_t i = 0; i < run.scene.images.size(); ++i) {
    is_new[i] = !model->IsRegistered(run.scene, static_cast<int>(i));
  }
  if (is_new.Count() == 0) return std::nullopt;
  const std::vector<ImagePair>& pairs = run.matches.pairs;
  const Mask is_in_forest = SpanningForest(run, *model);
  ViewGraph selected;
  for (size_t i = 0; i < pairs.size(); ++i) {
    if (is_in_forest[i] || is_new[pairs[i].image_idx1] ||
        is_new[pairs[i].image_idx2]) {
      selected.pairs.push_back(pairs[i]);
    }
  }
  return selected;
}

}  // namespace mgsfm

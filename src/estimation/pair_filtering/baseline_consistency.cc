// SPDX-License-Identifier: BSD-3-Clause
#include "pair_filtering/baseline_consistency.h"

#include <algorithm>
#include <cstddef>

#include "mgsfm/base/error.h"
#include "pair_filtering/drift_bound.h"

namespace mgsfm {

using Eigen::Vector3d;

std::optional<Vector3d> BaselineByPositions(const ImagePair& pair,
                                            const CameraCenters& centers) {
  const auto& center1 = centers[pair.image_idx1];
  const auto& center2 = centers[pair.image_idx2];
  if (!center1 || !center2) return std::nullopt;
  return *center2 - *center1;
}

Mask FindInconsistentBaselines(const PairEvidence& evidence,
                               const Mask& is_in_skeleton,
                               const BaselineComparison& by_skeleton,
                               double max_drift) {
  const auto& [measured, centers] = by_skeleton;
  const FramePairIndex& index = evidence.index;
  const ViewGraph& view_graph = evidence.view_graph;
  MGSFM_CHECK_EQ(measured.size(), view_graph.pairs.size());
  const DriftBound bound(index, view_graph, is_in_skeleton,
                         [&of = by_skeleton.measured](size_t i) {
                           MGSFM_CHECK(of[i].has_value());
                           return of[i]->baseline_in_world.norm();
                         },
                         {DriftGrowth::kProportional, max_drift});
  Mask is_inconsistent(measured.size(), false);
  size_t num_judged = 0;
  for (size_t i = 0; i < measured.size(); ++i) {
    if (!measured[i] || !measured[i]->is_comparable ||
        !index.Of(i).IsBetweenFrames()) {
      continue;
    }
    const auto baseline = BaselineByPositions(view_graph.pairs[i], centers);
    if (!baseline) continue;
    ++num_judged;
    is_inconsistent[i] =
        (*baseline - measured[i]->baseline_in_world).norm() >
        bound.Of(index.Of(i)) + evidence.options.max_baseline_error_in_depths *
                                    measured[i]->typical_depth;
  }
  if (RejectsTooMany(is_inconsistent.Count(), num_judged)) {
    is_inconsistent.assign(measured.size(), false);
  }
  return is_inconsistent;
}

std::vector<double> BaselineDriftBounds(const PairFilteringOptions& options) {
  // The first bound is loose because one camera drifts in scale and loops must
  // close. Small steps drop the worst pairs before the others are judged.
  // docs/results/constants.md compares fewer and more of them.
  constexpr double kDivisors[] = {1.0, 2.0, 4.0, 10.0};
  std::vector<double> bounds;
  for (const double divisor : kDivisors) {
    bounds.push_back(options.max_baseline_drift / divisor);
  }
  return bounds;
}

Mask FindInconsistentPairs(const ViewGraph& view_graph,
                           const BaselineComparison& comparison,
                           const PairFilteringOptions& options) {
  const auto& [measured, centers] = comparison;
  MGSFM_CHECK_EQ(measured.size(), view_graph.pairs.size());
  Mask is_inconsistent(measured.size(), false);
  for (size_t i = 0; i < measured.size(); ++i) {
    if (!measured[i]) continue;
    const auto baseline = BaselineByPositions(view_graph.pairs[i], centers);
    if (!baseline) continue;
    const Vector3d& expected = measured[i]->baseline_in_world;
    const double error = (*baseline - expected).norm();
    is_inconsistent[i] =
        error > options.max_relative_baseline_error *
                    std::max(expected.norm(), baseline->norm()) &&
        error >
            options.max_baseline_error_in_depths * measured[i]->typical_depth;
  }
  return is_inconsistent;
}

int CountViolatedSkeletonEdges(const ViewGraph& view_graph,
                               const Mask& is_in_skeleton,
                               const BaselineComparison& by_skeleton,
                               const BaselineComparison& by_others,
                               const PairFilteringOptions& options) {
  const Mask contradicts_skeleton =
      FindInconsistentPairs(view_graph, by_skeleton, options);
  const Mask contradicts_others =
      FindInconsistentPairs(view_graph, by_others, options);
  int num_violated = 0;
  for (size_t i = 0; i < is_in_skeleton.size(); ++i) {
    if (!is_in_skeleton[i] || contradicts_skeleton[i]) continue;
    const ImagePair& pair = view_graph.pairs[i];
    const bool is_missing = BaselineByPositions(pair, by_skeleton.centers) &&
                            !BaselineByPositions(pair, by_others.centers);
    num_violated += contradicts_others[i] || is_missing;
  }
  return num_violated;
}

}  // namespace mgsfm

// SPDX-License-Identifier: BSD-3-Clause
#include "pair_filtering/skeleton_consistency.h"

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <vector>

#include "base/ranges.h"
#include "geometry/so3.h"
#include "math/robust_scale.h"
#include "math/spanning_tree.h"
#include "mgsfm/base/error.h"

namespace mgsfm {

using Eigen::Quaterniond;
using Eigen::Vector3d;

namespace {

// Half is the breakdown point of a majority vote; a third keeps a margin.
constexpr double kMaxRejectedShare = 1.0 / 3.0;

// `length_of_pair(pair_idx)` is the length of a pair of the skeletal graph that
// connects two frames.
template <class Function>
TreePathLengths PathsThroughSkeleton(const PairEvidence& evidence,
                                     const Mask& is_in_skeleton,
                                     const Function& length_of_pair) {
  std::vector<GraphEdge> edges;
  std::vector<double> lengths;
  for (size_t i = 0; i < is_in_skeleton.size(); ++i) {
    const FramePair& frames = evidence.index.Of(i);
    if (!is_in_skeleton[i] || !frames.IsBetweenFrames()) continue;
    edges.push_back(
        {frames.frame_idx1, frames.frame_idx2,
         static_cast<double>(evidence.view_graph.pairs[i].matches.size())});
    lengths.push_back(length_of_pair(i));
  }
  return {evidence.index.num_frames(), edges, lengths};
}

// The rejected pairs, or none if they are too many.
Mask UnlessTooMany(Mask is_rejected, size_t num_judged) {
  if (static_cast<double>(is_rejected.Count()) >
      kMaxRejectedShare * static_cast<double>(num_judged)) {
    is_rejected.assign(is_rejected.size(), false);
  }
  return is_rejected;
}

}  // namespace

std::optional<std::pair<Quaterniond, Quaterniond>> RotationsOfImages(
    const Scene& scene, const ImagePair& pair,
    const RotationEstimate& rotations) {
  const auto rotation1 = rotations.CamFromWorld(scene, pair.image_idx1);
  const auto rotation2 = rotations.CamFromWorld(scene, pair.image_idx2);
  const auto component = [&](int image_idx) {
    return rotations.component[scene.images[image_idx].frame_idx];
  };
  if (!rotation1 || !rotation2 ||
      component(pair.image_idx1) != component(pair.image_idx2)) {
    return std::nullopt;
  }
  return std::pair(*rotation1, *rotation2);
}

Mask FindInconsistentRotations(const PairEvidence& evidence,
                               const Mask& is_in_skeleton,
                               const RotationEstimate& by_skeleton) {
  const PairFilteringOptions& options = evidence.options;
  const Mask& pair_is_used = evidence.pair_is_used;
  MGSFM_CHECK_EQ(pair_is_used.size(), evidence.view_graph.pairs.size());
  std::vector<std::optional<double>> deviations(pair_is_used.size());
  std::vector<double> known;
  for (size_t i = 0; i < deviations.size(); ++i) {
    const ImagePair& pair = evidence.view_graph.pairs[i];
    if (!pair_is_used[i] || !pair.relative_pose) continue;
    const auto rotations = RotationsOfImages(evidence.scene, pair, by_skeleton);
    if (!rotations) continue;
    deviations[i] =
        AngleBetween(pair.relative_pose->cam2_from_cam1 * rotations->first,
                     rotations->second);
    known.push_back(*deviations[i]);
  }
  Mask is_inconsistent(pair_is_used.size(), false);
  if (known.empty()) return is_inconsistent;
  const double rate = options.rotation_drift_in_sigmas * RobustSigma<3>(known);
  const TreePathLengths paths = PathsThroughSkeleton(
      evidence, is_in_skeleton, [](size_t) { return 1.0; });
  for (size_t i = 0; i < deviations.size(); ++i) {
    if (!deviations[i] || is_in_skeleton[i]) continue;
    const auto& frames = evidence.index.Of(i);
    const double length = paths.Between(frames.frame_idx1, frames.frame_idx2);
    is_inconsistent[i] =
        *deviations[i] > DegToRad(options.max_rotation_error_deg) +
                             std::min(rate * std::sqrt(length),
                                      DegToRad(options.max_rotation_drift_deg));
  }
  return UnlessTooMany(std::move(is_inconsistent), known.size());
}

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
  const MeasuredBaselines& measured = by_skeleton.measured;
  MGSFM_CHECK_EQ(measured.size(), evidence.view_graph.pairs.size());
  const TreePathLengths paths =
      PathsThroughSkeleton(evidence, is_in_skeleton, [&](size_t i) {
        MGSFM_CHECK(measured[i].has_value());
        return measured[i]->baseline_in_world.norm();
      });
  Mask is_inconsistent(measured.size(), false);
  size_t num_judged = 0;
  for (size_t i = 0; i < measured.size(); ++i) {
    const auto& frames = evidence.index.Of(i);
    if (!measured[i] || !measured[i]->is_comparable ||
        !frames.IsBetweenFrames()) {
      continue;
    }
    const auto baseline =
        BaselineByPositions(evidence.view_graph.pairs[i], by_skeleton.centers);
    if (!baseline) continue;
    ++num_judged;
    is_inconsistent[i] =
        (*baseline - measured[i]->baseline_in_world).norm() >
        max_drift * paths.Between(frames.frame_idx1, frames.frame_idx2) +
            evidence.options.max_baseline_error_in_depths *
                measured[i]->typical_depth;
  }
  return UnlessTooMany(std::move(is_inconsistent), num_judged);
}

std::vector<double> BaselineDriftBounds(const PairFilteringOptions& options) {
  // The first bound is loose because a single camera drifts in scale and loops
  // must still close. Small steps drop the worst pairs before the others are
  // judged. docs/results/constants.md compares other numbers of steps.
  constexpr double kDivisors[] = {1.0, 2.0, 4.0, 10.0};
  return Transformed(kDivisors, [&](double divisor) {
    return options.max_baseline_drift / divisor;
  });
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

// SPDX-License-Identifier: BSD-3-Clause
#include "pair_filtering/skeleton_consistency.h"

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <optional>
#include <vector>

#include "base/ranges.h"
#include "geometry/so3.h"
#include "math/robust_scale.h"
#include "mgsfm/base/error.h"

namespace mgsfm {
namespace {

// Half is the breakdown point of a majority vote; a third keeps a margin.
constexpr double kMaxRejectedShare = 1.0 / 3.0;

TreePathLengths PathsThroughSkeleton(
    const FramePairIndex& index, const ViewGraph& view_graph,
    const Mask& is_in_skeleton,
    const std::function<double(size_t)>& length_of_pair) {
  std::vector<GraphEdge> edges;
  std::vector<double> lengths;
  for (size_t i = 0; i < is_in_skeleton.size(); ++i) {
    const FramePairIndex::FramePair& frames = index.Of(i);
    if (!is_in_skeleton[i] || !frames.IsBetweenFrames()) continue;
    edges.push_back({frames.frame_idx1, frames.frame_idx2,
                     static_cast<double>(view_graph.pairs[i].matches.size())});
    lengths.push_back(length_of_pair(i));
  }
  return {index.num_frames(), edges, lengths};
}

}  // namespace

DriftBound::DriftBound(const FramePairIndex& index, const ViewGraph& view_graph,
                       const Mask& is_in_skeleton,
                       const std::function<double(size_t)>& length_of_pair,
                       const Model& model)
    : paths_(PathsThroughSkeleton(index, view_graph, is_in_skeleton,
                                  length_of_pair)),
      model_(model) {}

double DriftBound::Of(const FramePairIndex::FramePair& frames) const {
  const double length = paths_.Between(frames.frame_idx1, frames.frame_idx2);
  const double growth =
      model_.growth == DriftGrowth::kRandomWalk ? std::sqrt(length) : length;
  return std::min(model_.rate * growth, model_.max);
}

bool RejectsTooMany(size_t num_rejected, size_t num_judged) {
  return static_cast<double>(num_rejected) >
         kMaxRejectedShare * static_cast<double>(num_judged);
}

namespace {

// Angle between the measured relative rotation and the one of the skeleton;
// nullopt if the skeleton does not connect the images.
std::optional<double> DeviationFromSkeleton(
    const Scene& scene, const ImagePair& pair,
    const RotationEstimate& by_skeleton) {
  const auto rotation1 = by_skeleton.CamFromWorld(scene, pair.image_idx1);
  const auto rotation2 = by_skeleton.CamFromWorld(scene, pair.image_idx2);
  const auto component = [&](int image_idx) {
    return by_skeleton.component[scene.images[image_idx].frame_idx];
  };
  if (!rotation1 || !rotation2 ||
      component(pair.image_idx1) != component(pair.image_idx2)) {
    return std::nullopt;
  }
  return AngleBetween(pair.relative_pose->cam2_from_cam1 * *rotation1,
                      *rotation2);
}

}  // namespace

Mask FindInconsistentRotations(const PairEvidence& evidence,
                               const Mask& is_in_skeleton,
                               const RotationEstimate& by_skeleton) {
  const auto& [scene, index, view_graph, pair_is_used, options, num_threads] =
      evidence;
  MGSFM_CHECK_EQ(pair_is_used.size(), view_graph.pairs.size());
  std::vector<std::optional<double>> deviations(pair_is_used.size());
  std::vector<double> known;
  for (size_t i = 0; i < deviations.size(); ++i) {
    const ImagePair& pair = view_graph.pairs[i];
    if (!pair_is_used[i] || !pair.relative_pose) continue;
    deviations[i] = DeviationFromSkeleton(scene, pair, by_skeleton);
    if (deviations[i]) known.push_back(*deviations[i]);
  }
  Mask is_inconsistent(pair_is_used.size(), false);
  if (known.empty()) return is_inconsistent;
  const DriftBound bound(
      index, view_graph, is_in_skeleton, [](size_t) { return 1.0; },
      {DriftGrowth::kRandomWalk,
       options.rotation_drift_in_sigmas * RobustSigma<3>(known),
       DegToRad(options.max_rotation_drift_deg)});
  for (size_t i = 0; i < deviations.size(); ++i) {
    if (!deviations[i] || is_in_skeleton[i]) continue;
    is_inconsistent[i] =
        *deviations[i] >
        DegToRad(options.max_rotation_error_deg) + bound.Of(index.Of(i));
  }
  if (RejectsTooMany(is_inconsistent.Count(), known.size())) {
    is_inconsistent.assign(is_inconsistent.size(), false);
  }
  return is_inconsistent;
}

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

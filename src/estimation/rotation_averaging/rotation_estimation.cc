// SPDX-License-Identifier: BSD-3-Clause
#include "rotation_averaging/rotation_estimation.h"

#include <algorithm>
#include <cstddef>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "base/ranges.h"
#include "geometry/so3.h"
#include "georegistration/world_frame.h"
#include "math/graph.h"
#include "mgsfm/base/error.h"
#include "pair_filtering/frame_pair_index.h"
#include "pair_filtering/skeletal_graph.h"
#include "pair_filtering/skeleton_consistency.h"
#include "pair_filtering/unsupported_bridges.h"
#include "rotation_averaging/rotation_problem.h"

namespace mgsfm {
namespace {

Mask Not(const Mask& mask) {
  Mask opposite;
  opposite.reserve(mask.size());
  for (const bool value : mask) opposite.push_back(!value);
  return opposite;
}

Mask PairsWithRelativePose(const ViewGraph& view_graph) {
  Mask has_relative_pose(view_graph.pairs.size());
  for (size_t i = 0; i < has_relative_pose.size(); ++i) {
    has_relative_pose[i] = view_graph.pairs[i].relative_pose.has_value();
  }
  return has_relative_pose;
}

EstimatedRotations NothingToAverage(const RotationInput& input,
                                    PairVerdicts verdicts,
                                    const Context& context) {
  const Scene& scene = input.scene;
  const size_t num_pairs = input.view_graph.pairs.size();
  context.Warning("None of the " + std::to_string(num_pairs) +
                  " image pairs has a relative pose: there are no rotations to "
                  "average.");
  EstimatedRotations result;
  result.verdicts = std::move(verdicts);
  RotationEstimate& estimate = result.estimate;
  estimate.rig_from_world.resize(scene.frames.size());
  estimate.component.resize(scene.frames.size());
  estimate.pair_is_inlier.resize(num_pairs);
  for (const Sensor& sensor : scene.sensors) {
    estimate.sensor_from_rig.emplace_back();
    result.summary.sensors.emplace_back();
    SensorRotationSummary& summary = result.summary.sensors.back();
    summary.is_observable = sensor.sensor_from_rig.has_value();
    summary.message =
        summary.is_observable ? "known" : "no image pair has a relative pose";
    if (!sensor.sensor_from_rig) continue;
    estimate.sensor_from_rig.back() =
        ToUnitQuaternion(sensor.sensor_from_rig->rotation);
  }
  result.summary.num_pairs_without_rotation = static_cast<int>(num_pairs);
  return result;
}

// Rotations from the pairs of a skeletal graph alone. They are only initial
// values, so warnings and progress would be misleading.
RotationEstimate AverageSkeleton(const RotationInput& input,
                                 const Mask& is_in_skeleton,
                                 const RotationAveragingOptions& options,
                                 const Context& context) {
  Context quiet = context;
  quiet.log = nullptr;
  quiet.progress = nullptr;
  return AverageRotations({input.scene, input.view_graph, is_in_skeleton},
                          options, quiet)
      .estimate;
}

void LogBridges(const RotationInput& input, const Mask& is_bridge,
                const Context& context) {
  int num_loops = 0;
  for (size_t i = 0; i < is_bridge.size(); ++i) {
    if (!is_bridge[i]) continue;
    if (input.index.IsLoop(input.index.Of(i))) {
      ++num_loops;
      continue;
    }
    const ImagePair& pair = input.view_graph.pairs[i];
    context.Info("The pair of images '" +
                 input.scene.images[pair.image_idx1].name + "' and '" +
                 input.scene.images[pair.image_idx2].name +
                 "' is rejected: it alone would connect two components of "
                 "frames, no third image supports its matches, and other "
                 "pairs contradict it. The components stay apart.");
  }
  if (num_loops == 0) return;
  context.Info(std::to_string(num_loops) +
               " loop pairs are rejected: they alone would connect parts of "
               "the sequence, and show only one place of either part. The "
               "parts stay apart; match more frames between them.");
}

Mask PairsWithUnknownSensor(const Scene& scene, const ViewGraph& view_graph,
                            const RotationEstimate& estimate) {
  const auto is_unknown = [&](int image_idx) {
    return !estimate.sensor_from_rig[scene.images[image_idx].sensor_idx];
  };
  Mask has_unknown(view_graph.pairs.size());
  for (size_t i = 0; i < has_unknown.size(); ++i) {
    const ImagePair& pair = view_graph.pairs[i];
    has_unknown[i] = is_unknown(pair.image_idx1) || is_unknown(pair.image_idx2);
  }
  return has_unknown;
}

// Rejection reasons of pairs that no filter rejected but the estimate lacks.
void RejectByEstimate(const FramePairIndex& index,
                      const RotationEstimate& estimate,
                      PairVerdicts* verdicts) {
  for (size_t i = 0; i < verdicts->size(); ++i) {
    if ((*verdicts)[i] || estimate.pair_is_inlier[i]) continue;
    const auto& component1 = estimate.component[index.Of(i).frame_idx1];
    const auto& component2 = estimate.component[index.Of(i).frame_idx2];
    (*verdicts)[i] =
        !component1 || !component2   ? RejectionReason::kFrameWithoutRotation
        : *component1 != *component2 ? RejectionReason::kDifferentComponents
                                     : RejectionReason::kInconsistentRotation;
  }
}

struct AveragedRotations {
  RotationResult result;
  std::optional<std::string> gravity_rejection;
};

// Ignores gravity priors that contradict the pairs.
AveragedRotations AverageWithGravity(const RotationInput& input,
                                     const Mask& is_used,
                                     const RotationEstimate* start,
                                     const RotationAveragingOptions& options,
                                     const Context& context) {
  // Gravity with noise of 5 degrees and 30 % of outliers keeps all pairs;
  // constant wrong gravity keeps 85 % (docs/results/constants.md).
  constexpr double kMinKeptShare = 0.95;
  const auto average = [&](const GravityPriors& gravity) {
    return AverageRotations(
        {input.scene, input.view_graph, is_used, start, gravity}, options,
        context);
  };
  const auto num_kept = [](const RotationResult& result) {
    return static_cast<double>(result.estimate.pair_is_inlier.Count());
  };
  AveragedRotations averaged{average(input.gravity), std::nullopt};
  if (input.gravity.IsEmpty() ||
      num_kept(averaged.result) >=
          kMinKeptShare * static_cast<double>(is_used.Count())) {
    return averaged;
  }
  RotationResult without = average(kNoGravity);
  if (num_kept(averaged.result) >= kMinKeptShare * num_kept(without)) {
    return averaged;
  }
  averaged.gravity_rejection =
      "the directions of gravity contradict " +
      std::to_string(
          static_cast<int>(num_kept(without) - num_kept(averaged.result))) +
      " image pairs that agree with each other; they are ignored";
  averaged.result = std::move(without);
  return averaged;
}

// The start of averaging, and the pairs that it rejects.
struct SkeletonResult {
  std::optional<RotationEstimate> start;
  Mask is_in_skeleton;
  Mask is_beyond_drift_bound;
};

SkeletonResult FilterBySkeleton(const RotationInput& input, const Mask& is_used,
                                const RotationOptions& options,
                                const Context& context) {
  const PairFilteringOptions& filtering = options.filtering;
  SkeletonResult result{std::nullopt, Mask(is_used.size(), false),
                        Mask(is_used.size(), false)};
  if (!filtering.use_skeletal_graph) return result;
  const PairEvidence evidence{input.scene, input.index, input.view_graph,
                              is_used,     filtering,   context.num_threads};
  result.is_in_skeleton = SelectSkeletalGraph(evidence);
  result.start =
      AverageSkeleton(input, result.is_in_skeleton, options.averaging, context);
  if (IsRuleOn(RejectionReason::kRotationBeyondDriftBound, filtering)) {
    result.is_beyond_drift_bound = FindInconsistentRotations(
        evidence, result.is_in_skeleton, *result.start);
  }
  return result;
}

// The rotations by the pairs that remain, and the pairs that rules reject.
struct SupportedRotations {
  AveragedRotations averaged;
  Mask is_bridge;
};

// Moves pairs from the used ones to the rejected ones.
void Move(const Mask& pairs, Mask* is_used, Mask* is_rejected) {
  for (size_t i = 0; i < pairs.size(); ++i) {
    if (!pairs[i]) continue;
    (*is_used)[i] = false;
    (*is_rejected)[i] = true;
  }
}

Mask LoopsOf(const FramePairIndex& index, Mask pairs) {
  for (size_t i = 0; i < pairs.size(); ++i) {
    if (!index.IsLoop(index.Of(i))) pairs[i] = false;
  }
  return pairs;
}

// Averages again without the loops that join parts without support, until there
// are none: they can have outvoted correct neighbors.
SupportedRotations AverageSupported(const RotationInput& input,
                                    const SkeletonResult& skeleton,
                                    const RotationOptions& options,
                                    const Context& context, Mask is_used) {
  SupportedRotations result{{}, Mask(is_used.size(), false)};
  Mask is_explained(is_used.size(), false);
  for (size_t i = 0; i < input.verdicts.size(); ++i) {
    is_explained[i] = input.verdicts[i].has_value();
  }
  while (true) {
    result.averaged = AverageWithGravity(
        input, is_used, skeleton.start ? &*skeleton.start : nullptr,
        options.averaging, context);
    const RotationEstimate& estimate = result.averaged.result.estimate;
    if (!IsRuleOn(RejectionReason::kUnsupportedBridge, options.filtering)) {
      return result;
    }
    const Mask is_bridge = FindUnsupportedBridges(
        {input.scene, input.index, input.view_graph, estimate.pair_is_inlier,
         options.filtering, context.num_threads},
        is_explained);
    const Mask loops = LoopsOf(input.index, is_bridge);
    Move(loops.Any() ? loops : is_bridge, &is_used, &result.is_bridge);
    if (!loops.Any() || !is_used.Any()) return result;
  }
}

}  // namespace

EstimatedRotations EstimateRotations(const RotationInput& input,
                                     const RotationOptions& options,
                                     const Context& context) {
  const Scene& scene = input.scene;
  const ViewGraph& view_graph = input.view_graph;
  EstimatedRotations result;
  result.verdicts.resize(view_graph.pairs.size());
  Mask is_used = PairsWithRelativePose(view_graph);
  Reject(Not(is_used), RejectionReason::kNoRelativePose, &result.verdicts);
  for (size_t i = 0; i < input.verdicts.size(); ++i) {
    if (!result.verdicts[i]) result.verdicts[i] = input.verdicts[i];
    if (input.verdicts[i]) is_used[i] = false;
  }
  if (!is_used.Any()) {
    return NothingToAverage(input, std::move(result.verdicts), context);
  }
  const SkeletonResult skeleton =
      FilterBySkeleton(input, is_used, options, context);
  is_used.Remove(skeleton.is_beyond_drift_bound);
  auto [averaged, is_bridge] =
      AverageSupported(input, skeleton, options, context, is_used);
  LogBridges(input, is_bridge, context);
  result.gravity_rejection = std::move(averaged.gravity_rejection);
  Mask is_kept = averaged.result.estimate.pair_is_inlier;
  is_kept.Remove(is_bridge);
  result.estimate = RestrictToPairs(scene, view_graph, is_kept,
                                    std::move(averaged.result.estimate));
  result.summary = std::move(averaged.result.summary);
  SummarizeEstimate(scene, view_graph, result.estimate,
                    result.gravity_rejection ? kNoGravity : input.gravity,
                    options.averaging, &result.summary);
  result.summary.num_unsupported_bridges = static_cast<int>(is_bridge.Count());

  Reject(PairsWithUnknownSensor(scene, view_graph, result.estimate),
         RejectionReason::kUnknownSensorRotation, &result.verdicts);
  Reject(skeleton.is_beyond_drift_bound,
         RejectionReason::kRotationBeyondDriftBound, &result.verdicts);
  Reject(is_bridge, RejectionReason::kUnsupportedBridge, &result.verdicts);
  RejectByEstimate(input.index, result.estimate, &result.verdicts);
  return result;
}

namespace {

ConnectedComponents FindFrameComponents(const Scene& scene,
                                        const ViewGraph& view_graph,
                                        const Mask& pair_is_kept) {
  std::vector<GraphEdge> edges;
  for (size_t i = 0; i < view_graph.pairs.size(); ++i) {
    if (!pair_is_kept[i]) continue;
    const ImagePair& pair = view_graph.pairs[i];
    const int frame1 = scene.images[pair.image_idx1].frame_idx;
    const int frame2 = scene.images[pair.image_idx2].frame_idx;
    if (frame1 != frame2) edges.push_back({frame1, frame2, 1.0});
  }
  return FindConnectedComponents(static_cast<int>(scene.frames.size()), edges);
}

// Per component: its position by descending size, then by first frame.
std::vector<int> RankBySize(const std::vector<int>& sizes) {
  std::vector<int> by_size = Indices(sizes.size());
  StableSortDescendingBy(&by_size, [&](int a) { return sizes[a]; });
  std::vector<int> rank(sizes.size());
  for (size_t i = 0; i < by_size.size(); ++i) {
    rank[by_size[i]] = static_cast<int>(i);
  }
  return rank;
}

}  // namespace

RotationEstimate RestrictToPairs(const Scene& scene,
                                 const ViewGraph& view_graph,
                                 const Mask& pair_is_kept,
                                 RotationEstimate estimate) {
  const size_t num_frames = scene.frames.size();
  MGSFM_CHECK_EQ(pair_is_kept.size(), view_graph.pairs.size());
  MGSFM_CHECK_EQ(estimate.rig_from_world.size(), num_frames);
  const ConnectedComponents components =
      FindFrameComponents(scene, view_graph, pair_is_kept);
  std::vector<int> sizes(components.num_components, 0);
  for (const int component : components.component) ++sizes[component];
  const std::vector<int> rank = RankBySize(sizes);
  estimate.component.assign(num_frames, std::nullopt);
  for (size_t f = 0; f < num_frames; ++f) {
    const int component = components.component[f];
    if (sizes[component] < 2) {
      estimate.rig_from_world[f].reset();
    } else if (estimate.rig_from_world[f]) {
      estimate.component[f] = rank[component];
    }
  }
  estimate.pair_is_inlier = pair_is_kept;
  for (size_t i = 0; i < view_graph.pairs.size(); ++i) {
    const int frame = scene.images[view_graph.pairs[i].image_idx1].frame_idx;
    if (!estimate.rig_from_world[frame]) estimate.pair_is_inlier[i] = false;
  }
  return estimate;
}

void SummarizeEstimate(const Scene& scene, const ViewGraph& view_graph,
                       const RotationEstimate& estimate,
                       const GravityPriors& gravity,
                       const RotationAveragingOptions& options,
                       RotationSummary* summary) {
  summary->num_components = 0;
  for (const std::optional<int>& component : estimate.component) {
    if (!component) continue;
    summary->num_components = std::max(summary->num_components, *component + 1);
  }
  summary->num_pairs_without_rotation = 0;
  summary->num_pairs_unobservable = 0;
  summary->num_pairs_dropped = 0;
  for (size_t i = 0; i < view_graph.pairs.size(); ++i) {
    const ImagePair& pair = view_graph.pairs[i];
    if (!pair.relative_pose) {
      ++summary->num_pairs_without_rotation;
    } else if (!IsUsable(scene, pair, estimate.sensor_from_rig)) {
      ++summary->num_pairs_unobservable;
    } else if (!estimate.pair_is_inlier[i]) {
      ++summary->num_pairs_dropped;
    }
  }
  if (gravity.IsEmpty()) return;
  std::vector<std::optional<Eigen::Quaterniond>> cam_from_world;
  for (size_t i = 0; i < scene.images.size(); ++i) {
    cam_from_world.push_back(estimate.CamFromWorld(scene, static_cast<int>(i)));
  }
  summary->gravity =
      EvaluateGravity(gravity, cam_from_world, options.gravity_sigma_deg);
}

}  // namespace mgsfm

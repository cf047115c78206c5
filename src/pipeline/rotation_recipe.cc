// SPDX-License-Identifier: BSD-3-Clause
#include "pipeline/rotation_recipe.h"

#include <cstddef>
#include <functional>
#include <optional>
#include <string>
#include <utility>

#include "geometry/so3.h"
#include "pair_filtering/contested_cuts.h"
#include "pair_filtering/frame_pair_index.h"
#include "pair_filtering/revisits.h"
#include "pair_filtering/rotation_consistency.h"
#include "pair_filtering/skeletal_graph.h"
#include "pair_filtering/turned_steps.h"
#include "pair_filtering/unsupported_bridges.h"
#include "rotation/rotation_components.h"

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

RotationResult NothingToAverage(const Scene& scene, const ViewGraph& view_graph,
                                const Context& context) {
  context.Warning("None of the " + std::to_string(view_graph.pairs.size()) +
                  " image pairs has a relative pose: there are no rotations to "
                  "average.");
  RotationResult result;
  RotationEstimate& estimate = result.estimate;
  estimate.rig_from_world.resize(scene.frames.size());
  estimate.component.resize(scene.frames.size());
  estimate.pair_is_inlier.resize(view_graph.pairs.size());
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
  result.summary.num_pairs_without_rotation =
      static_cast<int>(view_graph.pairs.size());
  return result;
}

// Rotations by the pairs of a skeletal graph alone. They are only a start, so
// their warnings and progress would mislead.
RotationEstimate AverageSkeleton(const Scene& scene,
                                 const ViewGraph& view_graph,
                                 const Mask& is_in_skeleton,
                                 const RotationAveragingOptions& options,
                                 const Context& context) {
  Context quiet = context;
  quiet.log = nullptr;
  quiet.progress = nullptr;
  return AverageRotations(scene, view_graph, is_in_skeleton, nullptr, options,
                          quiet)
      .estimate;
}

void LogBridges(const Scene& scene, const ViewGraph& view_graph,
                const Mask& is_bridge, const Context& context) {
  for (size_t i = 0; i < is_bridge.size(); ++i) {
    if (!is_bridge[i]) continue;
    const ImagePair& pair = view_graph.pairs[i];
    context.Info("The pair of images '" + scene.images[pair.image_idx1].name +
                 "' and '" + scene.images[pair.image_idx2].name +
                 "' is rejected: it alone would connect two components of "
                 "frames, no third image supports its matches, and other "
                 "pairs contradict it. The components stay apart.");
  }
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

// The reasons of pairs that no filter rejected but the estimate does not keep.
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

// Gravity priors that contradict the pairs are ignored.
AveragedRotations AverageWithGravity(
    const Scene& scene, const ViewGraph& view_graph, const Mask& is_used,
    const RotationEstimate* start, const GravityPriors& gravity,
    const RotationAveragingOptions& options, const Context& context) {
  // Gravity with noise of 5 degrees and 30 % of outliers keeps all pairs;
  // constant wrong gravity keeps 85 % (docs/results/constants.md).
  constexpr double kMinKeptShare = 0.95;
  const auto average = [&](const GravityPriors& priors) {
    return AverageRotations(scene, view_graph, is_used, start, options, context,
                            priors);
  };
  const auto num_kept = [](const RotationResult& result) {
    return static_cast<double>(result.estimate.pair_is_inlier.Count());
  };
  AveragedRotations averaged{average(gravity), std::nullopt};
  if (gravity.IsEmpty() ||
      num_kept(averaged.result) >=
          kMinKeptShare * static_cast<double>(is_used.Count())) {
    return averaged;
  }
  RotationResult without = average({});
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

SkeletonResult FilterBySkeleton(const Scene& scene, const FramePairIndex& index,
                                const ViewGraph& view_graph,
                                const Mask& is_used,
                                const RotationAveragingOptions& options,
                                const PairFilteringOptions& filtering,
                                const Context& context) {
  SkeletonResult result{std::nullopt, Mask(is_used.size(), false),
                        Mask(is_used.size(), false)};
  if (!filtering.use_skeletal_graph) return result;
  result.is_in_skeleton = SelectSkeletalGraph(index, view_graph, is_used,
                                              filtering, context.num_threads);
  result.start = AverageSkeleton(scene, view_graph, result.is_in_skeleton,
                                 options, context);
  if (filtering.use_rotation_consistency) {
    result.is_beyond_drift_bound = FindInconsistentRotations(
        scene, index, view_graph, is_used, result.is_in_skeleton, *result.start,
        filtering);
  }
  return result;
}

// Averages without the loop pairs that turn steps of a sequence. Revisits stay:
// if they turn a step, the error is in other steps. The rotations without other
// loops across the turned steps judge these loops. Their drift bound is
// tightened until none of them crosses a turned step. Updates the pairs that
// are used.
AveragedRotations AverageWithoutTurningLoops(
    const Scene& scene, const FramePairIndex& index,
    const ViewGraph& view_graph, const Mask& is_in_skeleton,
    const PairFilteringOptions& filtering,
    const std::function<AveragedRotations(const Mask&)>& average,
    Mask* is_used) {
  // The last bound leaves only revisits across a turned step.
  constexpr double kSharesOfBound[] = {1.0, 0.5, 0.25, 0.0};
  AveragedRotations averaged = average(*is_used);
  if (!filtering.use_skeletal_graph || !filtering.use_rotation_consistency) {
    return averaged;
  }
  const Mask is_revisit = FindRevisits(index, *is_used);
  const auto find_loops = [&] {
    Mask is_across =
        FindLoopsAcross(index, *is_used,
                        FindTurnedSteps(scene, index, view_graph, *is_used,
                                        averaged.result.estimate));
    is_across.Remove(is_revisit);
    return is_across;
  };
  for (const double share : kSharesOfBound) {
    Mask is_rejected = find_loops();
    if (!is_rejected.Any()) break;
    Mask without_loops = *is_used;
    without_loops.Remove(is_rejected);
    AveragedRotations without = average(without_loops);
    if (share == 0.0) {
      *is_used = std::move(without_loops);
      return without;
    }
    PairFilteringOptions bound = filtering;
    bound.max_rotation_error_deg = share * *filtering.max_rotation_error_deg;
    bound.rotation_drift_in_sigmas =
        share * *filtering.rotation_drift_in_sigmas;
    const Mask is_inconsistent = FindInconsistentRotations(
        scene, index, view_graph, *is_used, is_in_skeleton,
        without.result.estimate, bound);
    is_rejected.Remove(Not(is_inconsistent));
    if (!is_rejected.Any()) continue;
    is_used->Remove(is_rejected);
    averaged = average(*is_used);
  }
  return averaged;
}

Mask FindBridges(const Scene& scene, const FramePairIndex& index,
                 const ViewGraph& view_graph, const Mask& pair_is_inlier,
                 const PairFilteringOptions& filtering,
                 const Context& context) {
  if (!filtering.use_unsupported_bridges) {
    return Mask(pair_is_inlier.size(), false);
  }
  Mask is_bridge = FindUnsupportedBridges(index, view_graph, pair_is_inlier,
                                          filtering, context.num_threads);
  LogBridges(scene, view_graph, is_bridge, context);
  return is_bridge;
}

// Rejects the pairs that contradict the motion of the rig, if it is known, and
// the loop pairs that would join parts by themselves.
void RejectByMotion(const FramePairIndex& index,
                    const Mask& pair_is_discontinuous,
                    const Mask& loop_contradicts_path, Mask* is_used,
                    PairVerdicts* verdicts) {
  if (pair_is_discontinuous.empty()) return;
  is_used->Remove(pair_is_discontinuous);
  Reject(pair_is_discontinuous, RejectionReason::kDiscontinuousMotion,
         verdicts);
  const Mask is_loop_across = FindLoopsAcrossContestedCuts(
      index, *is_used, pair_is_discontinuous, loop_contradicts_path);
  is_used->Remove(is_loop_across);
  Reject(is_loop_across, RejectionReason::kUnsupportedBridge, verdicts);
}

}  // namespace

EstimatedRotations EstimateRotations(
    const Scene& scene, const FramePairIndex& index,
    const ViewGraph& view_graph, const GravityPriors& gravity,
    const RotationAveragingOptions& options,
    const PairFilteringOptions& filtering, const Context& context,
    const Mask& pair_is_discontinuous, const Mask& loop_contradicts_path) {
  EstimatedRotations result;
  result.verdicts.resize(view_graph.pairs.size());
  Mask is_used = PairsWithRelativePose(view_graph);
  Reject(Not(is_used), RejectionReason::kNoRelativePose, &result.verdicts);
  RejectByMotion(index, pair_is_discontinuous, loop_contradicts_path, &is_used,
                 &result.verdicts);
  RotationResult averaged;
  if (!is_used.Any()) {
    averaged = NothingToAverage(scene, view_graph, context);
    result.estimate = std::move(averaged.estimate);
    result.summary = std::move(averaged.summary);
    return result;
  }
  const SkeletonResult skeleton = FilterBySkeleton(
      scene, index, view_graph, is_used, options, filtering, context);
  is_used.Remove(skeleton.is_beyond_drift_bound);
  const Mask within_drift_bound = is_used;
  AveragedRotations with_gravity = AverageWithoutTurningLoops(
      scene, index, view_graph, skeleton.is_in_skeleton, filtering,
      [&](const Mask& is_averaged) {
        return AverageWithGravity(scene, view_graph, is_averaged,
                                  skeleton.start ? &*skeleton.start : nullptr,
                                  gravity, options, context);
      },
      &is_used);
  Mask turns_steps = within_drift_bound;
  turns_steps.Remove(is_used);
  averaged = std::move(with_gravity.result);
  result.gravity_rejection = std::move(with_gravity.gravity_rejection);
  const GravityPriors used_gravity =
      result.gravity_rejection ? GravityPriors() : gravity;
  Mask is_kept = averaged.estimate.pair_is_inlier;
  const Mask is_bridge =
      FindBridges(scene, index, view_graph, is_kept, filtering, context);
  is_kept.Remove(is_bridge);
  result.estimate =
      RestrictToPairs(scene, view_graph, is_kept, std::move(averaged.estimate));
  result.summary = std::move(averaged.summary);
  SummarizeEstimate(scene, view_graph, result.estimate, used_gravity, options,
                    &result.summary);
  result.summary.num_unsupported_bridges = static_cast<int>(is_bridge.Count());

  Reject(PairsWithUnknownSensor(scene, view_graph, result.estimate),
         RejectionReason::kUnknownSensorRotation, &result.verdicts);
  for (const Mask& is_rejected :
       {skeleton.is_beyond_drift_bound, turns_steps}) {
    Reject(is_rejected, RejectionReason::kRotationBeyondDriftBound,
           &result.verdicts);
  }
  Reject(is_bridge, RejectionReason::kUnsupportedBridge, &result.verdicts);
  RejectByEstimate(index, result.estimate, &result.verdicts);
  return result;
}

}  // namespace mgsfm

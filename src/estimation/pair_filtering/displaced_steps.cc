// SPDX-License-Identifier: BSD-3-Clause
#include "pair_filtering/displaced_steps.h"

#include <algorithm>
#include <cstddef>
#include <utility>

#include "geometry/so3.h"
#include "math/statistics.h"

namespace mgsfm {
namespace {

using Eigen::Vector3d;

// A few correct pairs can be the only ones that show the static scene. Values
// of 0.8 and 0.95 change errors by at most 5 % (docs/results/constants.md).
constexpr double kMinShareAgreeing = 0.9;
// docs/results/constants.md lists the turns of correct and of turned steps.
constexpr double kMinTurn_rad = DegToRad(1.0);

std::optional<Vector3d> CommonDeviation(
    const std::vector<Vector3d>& deviations) {
  if (deviations.empty()) return std::nullopt;
  const Vector3d common = MedianOfCoordinates(deviations);
  const auto num_agreeing = std::count_if(
      deviations.begin(), deviations.end(),
      [&](const auto& e) { return (e - common).norm() < e.norm(); });
  if (static_cast<double>(num_agreeing) <
      kMinShareAgreeing * static_cast<double>(deviations.size())) {
    return std::nullopt;
  }
  return common;
}

// `deviation_of(pair_idx)` is from image 1 to image 2; nullopt for pairs that
// do not count.
template <class Function>
StepDeviations FindCommonDeviations(const PairEvidence& evidence,
                                    const Function& deviation_of) {
  const FramePairIndex& index = evidence.index;
  StepDeviations common(index.num_frames());
  if (!index.is_sequence()) return common;
  // Per frame: the deviations of the pairs across the step to it.
  std::vector<std::vector<Vector3d>> across(index.num_frames());
  for (size_t i = 0; i < index.num_pairs(); ++i) {
    const auto& frames = index.Of(i);
    if (!evidence.pair_is_used[i] || !frames.IsBetweenFrames() ||
        index.IsLoop(frames)) {
      continue;
    }
    const std::optional<Vector3d> deviation = deviation_of(i);
    if (!deviation) continue;
    const ImagePair& pair = evidence.view_graph.pairs[i];
    int earlier = evidence.scene.images[pair.image_idx1].frame_idx;
    int later = evidence.scene.images[pair.image_idx2].frame_idx;
    const bool is_in_order = index.order()->IsBefore(earlier, later);
    if (!is_in_order) std::swap(earlier, later);
    for (int f = later; f != earlier; f = *index.order()->Previous(f)) {
      across[f].push_back(is_in_order ? *deviation : Vector3d(-*deviation));
    }
  }
  for (size_t f = 0; f < common.size(); ++f) {
    common[f] = CommonDeviation(across[f]);
  }
  return common;
}

// Per frame: the translation of the step to it, if both frames have a position.
StepDeviations StepsOf(const FramePairIndex& index,
                       const std::vector<std::optional<Vector3d>>& center) {
  StepDeviations steps(center.size());
  for (size_t f = 0; f < steps.size(); ++f) {
    const auto previous = index.order()->Previous(static_cast<int>(f));
    if (previous && center[f] && center[*previous]) {
      steps[f] = *center[f] - *center[*previous];
    }
  }
  return steps;
}

double MedianLength(const StepDeviations& steps) {
  std::vector<double> lengths;
  for (const auto& step : steps) {
    if (step) lengths.push_back(step->norm());
  }
  return lengths.empty() ? 0.0 : Median(std::move(lengths));
}

}  // namespace

StepDeviations FindDisplacedSteps(
    const PairEvidence& evidence, const BaselineComparison& comparison,
    const std::vector<std::optional<Vector3d>>& frame_center_in_world) {
  const StepDeviations common =
      FindCommonDeviations(evidence, [&](size_t i) -> std::optional<Vector3d> {
        const auto& measured = comparison.measured[i];
        const auto baseline = BaselineByPositions(evidence.view_graph.pairs[i],
                                                  comparison.centers);
        if (!measured || !measured->is_comparable || !baseline) {
          return std::nullopt;
        }
        return measured->baseline_in_world - *baseline;
      });
  StepDeviations displaced(common.size());
  if (!evidence.index.is_sequence()) return displaced;
  const StepDeviations steps = StepsOf(evidence.index, frame_center_in_world);
  const double median_step = MedianLength(steps);
  for (size_t f = 0; f < common.size(); ++f) {
    if (!common[f] || !steps[f]) continue;
    const double length = std::max(
        {steps[f]->norm(), (*steps[f] + *common[f]).norm(), median_step});
    if (common[f]->norm() >
        evidence.options.max_relative_baseline_error * length) {
      displaced[f] = common[f];
    }
  }
  return displaced;
}

Mask FindTurnedSteps(const PairEvidence& evidence,
                     const RotationEstimate& rotations) {
  const StepDeviations turns =
      FindCommonDeviations(evidence, [&](size_t i) -> std::optional<Vector3d> {
        const ImagePair& pair = evidence.view_graph.pairs[i];
        const auto of_images =
            RotationsOfImages(evidence.scene, pair, rotations);
        if (!of_images) return std::nullopt;
        return LogSO3(of_images->second.inverse() *
                      pair.relative_pose->cam2_from_cam1 * of_images->first);
      });
  Mask is_turned(turns.size(), false);
  for (size_t f = 0; f < turns.size(); ++f) {
    is_turned[f] = turns[f] && turns[f]->norm() > kMinTurn_rad;
  }
  return is_turned;
}

}  // namespace mgsfm

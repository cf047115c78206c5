// SPDX-License-Identifier: BSD-3-Clause
#include "pair_filtering/displaced_steps.h"

#include <algorithm>
#include <cstddef>
#include <utility>

#include "math/statistics.h"

namespace mgsfm {
namespace {

using Eigen::Vector3d;

// Per frame: the translation of the step to it, if both frames have a position.
std::vector<std::optional<Vector3d>> StepsOf(
    const std::vector<std::optional<int>>& previous,
    const std::vector<std::optional<Vector3d>>& center) {
  std::vector<std::optional<Vector3d>> steps(center.size());
  for (size_t f = 0; f < steps.size(); ++f) {
    if (previous[f] && center[f] && center[*previous[f]]) {
      steps[f] = *center[f] - *center[*previous[f]];
    }
  }
  return steps;
}

double MedianLength(const std::vector<std::optional<Vector3d>>& steps) {
  std::vector<double> lengths;
  for (const auto& step : steps) {
    if (step) lengths.push_back(step->norm());
  }
  return lengths.empty() ? 0.0 : Median(std::move(lengths));
}

}  // namespace

StepDeviations FindDisplacedSteps(
    const Scene& scene, const FramePairIndex& index,
    const ViewGraph& view_graph, const Mask& pair_is_used,
    const BaselineComparison& comparison,
    const std::vector<std::optional<Vector3d>>& frame_center_in_world,
    const PairFilteringOptions& options) {
  StepDeviations displaced(index.num_frames());
  if (!index.is_sequence() || !options.use_baseline_consistency) {
    return displaced;
  }
  PairDeviations deviations(pair_is_used.size());
  for (size_t i = 0; i < deviations.size(); ++i) {
    const auto& measured = comparison.measured[i];
    const auto baseline =
        BaselineByPositions(view_graph.pairs[i], comparison.centers);
    if (!pair_is_used[i] || !measured || !measured->is_comparable ||
        !baseline) {
      continue;
    }
    deviations[i] = measured->baseline_in_world - *baseline;
  }
  const StepDeviations common =
      FindCommonDeviations(scene, index, view_graph, deviations);
  const std::vector<std::optional<Vector3d>> steps =
      StepsOf(PreviousFrames(index), frame_center_in_world);
  const double median_step = MedianLength(steps);
  for (size_t f = 0; f < common.size(); ++f) {
    if (!common[f] || !steps[f]) continue;
    const double length = std::max(
        {steps[f]->norm(), (*steps[f] + *common[f]).norm(), median_step});
    if (common[f]->norm() > options.max_relative_baseline_error * length) {
      displaced[f] = common[f];
    }
  }
  return displaced;
}

}  // namespace mgsfm

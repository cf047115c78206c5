// SPDX-License-Identifier: BSD-3-Clause
#include "pair_filtering/displaced_steps.h"

#include <algorithm>
#include <cstddef>

namespace mgsfm {

using Eigen::Vector3d;

StepDeviations FindDisplacedSteps(
    const Scene& scene, const FramePairIndex& index,
    const ViewGraph& view_graph, const Mask& pair_is_used,
    const BaselineComparison& comparison,
    const std::vector<std::optional<Vector3d>>& frame_center_in_world,
    const PairFilteringOptions& options) {
  StepDeviations displaced(index.num_frames());
  if (!index.is_sequence()) return displaced;
  PairDeviations deviations(pair_is_used.size());
  for (size_t i = 0; i < deviations.size(); ++i) {
    const auto& measured = comparison.measured[i];
    const auto baseline =
        BaselineByPositions(view_graph.pairs[i], comparison.centers);
    if (!pair_is_used[i] || !measured || !baseline) continue;
    deviations[i] = measured->baseline_in_world - *baseline;
  }
  const StepDeviations common =
      FindCommonDeviations(scene, index, view_graph, deviations);
  const std::vector<std::optional<int>> previous = PreviousFrames(index);
  for (size_t f = 0; f < common.size(); ++f) {
    if (!common[f] || !frame_center_in_world[f] ||
        !frame_center_in_world[*previous[f]]) {
      continue;
    }
    const Vector3d step =
        *frame_center_in_world[f] - *frame_center_in_world[*previous[f]];
    const double max_error = options.max_relative_baseline_error *
                             std::max(step.norm(), (step + *common[f]).norm());
    if (common[f]->norm() > max_error) displaced[f] = common[f];
  }
  return displaced;
}

}  // namespace mgsfm

// SPDX-License-Identifier: BSD-3-Clause
#include "pair_filtering/step_deviations.h"

#include <algorithm>
#include <cstddef>

#include "math/statistics.h"

namespace mgsfm {
namespace {

using Eigen::Vector3d;

// A few correct pairs can be all that show the static scene. Values of 0.8 and
// 0.95 change errors by at most 5 % (docs/results/constants.md).
constexpr double kMinShareAgreeing = 0.9;

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

}  // namespace

std::vector<std::optional<int>> PreviousFrames(const FramePairIndex& index) {
  std::vector<std::optional<int>> previous(index.num_frames());
  if (!index.is_sequence()) return previous;
  for (const std::vector<int>& sequence : index.order()->sequences()) {
    for (size_t k = 1; k < sequence.size(); ++k) {
      previous[sequence[k]] = sequence[k - 1];
    }
  }
  return previous;
}

StepDeviations FindCommonDeviations(const Scene& scene,
                                    const FramePairIndex& index,
                                    const ViewGraph& view_graph,
                                    const PairDeviations& deviations) {
  StepDeviations common(index.num_frames());
  if (!index.is_sequence()) return common;
  const TemporalOrder& order = *index.order();
  const std::vector<std::optional<int>> previous = PreviousFrames(index);
  // Per frame: the deviations of the pairs across the step to it.
  std::vector<std::vector<Vector3d>> across(index.num_frames());
  for (size_t i = 0; i < deviations.size(); ++i) {
    const auto& frames = index.Of(i);
    if (!deviations[i] || !frames.IsBetweenFrames() || index.IsLoop(frames)) {
      continue;
    }
    const ImagePair& pair = view_graph.pairs[i];
    int earlier = scene.images[pair.image_idx1].frame_idx;
    int later = scene.images[pair.image_idx2].frame_idx;
    const bool is_in_order = order.IsBefore(earlier, later);
    if (!is_in_order) std::swap(earlier, later);
    for (int f = later; f != earlier; f = *previous[f]) {
      across[f].push_back(is_in_order ? *deviations[i]
                                      : Vector3d(-*deviations[i]));
    }
  }
  for (size_t f = 0; f < common.size(); ++f) {
    common[f] = CommonDeviation(across[f]);
  }
  return common;
}

}  // namespace mgsfm

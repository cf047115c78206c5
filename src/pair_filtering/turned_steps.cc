// SPDX-License-Identifier: BSD-3-Clause
#include "pair_filtering/turned_steps.h"

#include <algorithm>
#include <cstddef>
#include <optional>
#include <utility>
#include <vector>

#include "geometry/so3.h"
#include "math/statistics.h"

namespace mgsfm {
namespace {

using Eigen::Vector3d;

// docs/results/hard_drives.md shows turns of sound and of turned steps.
constexpr double kMinTurn_rad = DegToRad(1.0);
// A few correct pairs can be all that show the static scene.
constexpr double kMinShareAgreeing = 0.9;

// The deviation of a pair, from its earlier to its later image.
std::optional<Vector3d> DeviationInWorld(const Scene& scene,
                                         const TemporalOrder& order,
                                         const ImagePair& pair,
                                         const RotationEstimate& rotations) {
  const auto rotation1 = rotations.CamFromWorld(scene, pair.image_idx1);
  const auto rotation2 = rotations.CamFromWorld(scene, pair.image_idx2);
  const int frame_idx1 = scene.images[pair.image_idx1].frame_idx;
  const int frame_idx2 = scene.images[pair.image_idx2].frame_idx;
  if (!rotation1 || !rotation2 ||
      rotations.component[frame_idx1] != rotations.component[frame_idx2]) {
    return std::nullopt;
  }
  const Vector3d deviation = LogSO3(
      rotation2->inverse() * pair.relative_pose->cam2_from_cam1 * *rotation1);
  return order.IsBefore(frame_idx1, frame_idx2) ? deviation
                                                : Vector3d(-deviation);
}

Vector3d MedianOfCoordinates(const std::vector<Vector3d>& vectors) {
  Vector3d median;
  for (int c = 0; c < 3; ++c) {
    std::vector<double> values;
    values.reserve(vectors.size());
    for (const Vector3d& v : vectors) values.push_back(v[c]);
    median[c] = Median(std::move(values));
  }
  return median;
}

std::optional<Vector3d> TurnOf(const std::vector<Vector3d>& deviations) {
  if (deviations.empty()) return std::nullopt;
  const Vector3d turn = MedianOfCoordinates(deviations);
  const auto num_agreeing = std::count_if(
      deviations.begin(), deviations.end(),
      [&](const auto& e) { return (e - turn).norm() < e.norm(); });
  if (turn.norm() <= kMinTurn_rad ||
      static_cast<double>(num_agreeing) <
          kMinShareAgreeing * static_cast<double>(deviations.size())) {
    return std::nullopt;
  }
  return turn;
}

// Per frame: the next one of its sequence; nullopt for the last.
std::vector<std::optional<int>> NextFrames(const FramePairIndex& index) {
  std::vector<std::optional<int>> next(index.num_frames());
  for (const std::vector<int>& sequence : index.order()->sequences()) {
    for (size_t k = 1; k < sequence.size(); ++k) {
      next[sequence[k - 1]] = sequence[k];
    }
  }
  return next;
}

}  // namespace

StepTurns FindStepTurns(const Scene& scene, const FramePairIndex& index,
                        const ViewGraph& view_graph, const Mask& pair_is_used,
                        const RotationEstimate& rotations) {
  StepTurns turns(index.num_frames());
  if (!index.is_sequence()) return turns;
  const TemporalOrder& order = *index.order();
  const std::vector<std::optional<int>> next = NextFrames(index);
  // Per frame: the deviations of the pairs across the step to it.
  std::vector<std::vector<Vector3d>> deviations(index.num_frames());
  for (size_t i = 0; i < pair_is_used.size(); ++i) {
    const auto& frames = index.Of(i);
    if (!pair_is_used[i] || !frames.IsBetweenFrames() || index.IsLoop(frames)) {
      continue;
    }
    const auto deviation =
        DeviationInWorld(scene, order, view_graph.pairs[i], rotations);
    if (!deviation) continue;
    int earlier = frames.frame_idx1, later = frames.frame_idx2;
    if (order.IsBefore(later, earlier)) std::swap(earlier, later);
    while (earlier != later) {
      earlier = *next[earlier];
      deviations[earlier].push_back(*deviation);
    }
  }
  for (size_t f = 0; f < turns.size(); ++f) turns[f] = TurnOf(deviations[f]);
  return turns;
}

Mask FindLoopsAcross(const FramePairIndex& index, const Mask& pair_is_used,
                     const StepTurns& turns) {
  Mask is_across(pair_is_used.size(), false);
  if (!index.is_sequence()) return is_across;
  // Per frame: the number of turned steps before it.
  std::vector<int> num_before(index.num_frames(), 0);
  for (const std::vector<int>& sequence : index.order()->sequences()) {
    int num_steps = 0;
    for (const int frame : sequence) {
      if (turns[frame]) ++num_steps;
      num_before[frame] = num_steps;
    }
  }
  for (size_t i = 0; i < is_across.size(); ++i) {
    const auto& frames = index.Of(i);
    is_across[i] =
        pair_is_used[i] && frames.time_gap && index.IsLoop(frames) &&
        num_before[frames.frame_idx1] != num_before[frames.frame_idx2];
  }
  return is_across;
}

}  // namespace mgsfm

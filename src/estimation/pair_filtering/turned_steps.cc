// SPDX-License-Identifier: BSD-3-Clause
#include "pair_filtering/turned_steps.h"

#include <Eigen/Core>
#include <cstddef>
#include <optional>
#include <vector>

#include "geometry/so3.h"
#include "pair_filtering/step_deviations.h"

namespace mgsfm {
namespace {

using Eigen::Vector3d;

// docs/results/constants.md shows turns of sound and of turned steps.
constexpr double kMinTurn_rad = DegToRad(1.0);

std::optional<Vector3d> DeviationInWorld(const Scene& scene,
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
  return LogSO3(rotation2->inverse() * pair.relative_pose->cam2_from_cam1 *
                *rotation1);
}

}  // namespace

Mask FindTurnedSteps(const Scene& scene, const FramePairIndex& index,
                     const ViewGraph& view_graph, const Mask& pair_is_used,
                     const RotationEstimate& rotations) {
  Mask is_turned(index.num_frames(), false);
  if (!index.is_sequence()) return is_turned;
  PairDeviations deviations(pair_is_used.size());
  for (size_t i = 0; i < deviations.size(); ++i) {
    if (!pair_is_used[i]) continue;
    deviations[i] = DeviationInWorld(scene, view_graph.pairs[i], rotations);
  }
  const StepDeviations turns =
      FindCommonDeviations(scene, index, view_graph, deviations);
  for (size_t f = 0; f < turns.size(); ++f) {
    is_turned[f] = turns[f] && turns[f]->norm() > kMinTurn_rad;
  }
  return is_turned;
}

}  // namespace mgsfm

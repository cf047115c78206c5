// SPDX-License-Identifier: BSD-3-Clause
#include "translation_averaging/measured_baselines.h"

#include <cstddef>
#include <optional>

namespace mgsfm {

MeasuredBaselines MeasureBaselines(
    const std::vector<BaselineDirection>& directions, const PairScales& scales,
    const std::vector<double>& group_factor) {
  MeasuredBaselines measured(directions.size());
  for (size_t i = 0; i < directions.size(); ++i) {
    const std::optional<PairScale>& pair = scales.pairs[i];
    if (!pair) continue;
    const double unit = group_factor[pair->group];
    const double length = pair->scale * unit;
    measured[i] = {length * directions[i].direction,
                   scales.typical_depth * unit, pair->group == 0};
  }
  return measured;
}

CameraCenters ComputeCameraCenters(const PositionProblem& problem,
                                   const Positions& positions) {
  CameraCenters centers(problem.world_from_cam.size());
  for (size_t i = 0; i < centers.size(); ++i) {
    const int image_idx = static_cast<int>(i);
    if (positions.IsPlaced(problem, image_idx)) {
      centers[i] = positions.CamCenter(problem, image_idx);
    }
  }
  return centers;
}

BaselineComparison CompareWith(const PositionProblem& problem,
                               const std::vector<BaselineDirection>& directions,
                               const PairScales& scales,
                               const std::vector<double>& group_factor,
                               const Positions& positions) {
  return {MeasureBaselines(directions, scales, group_factor),
          ComputeCameraCenters(problem, positions)};
}

}  // namespace mgsfm

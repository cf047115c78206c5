// SPDX-License-Identifier: BSD-3-Clause
#include "translation/measured_baselines.h"

#include <cstddef>

namespace mgsfm {

MeasuredBaselines MeasureBaselines(
    const std::vector<BaselineDirection>& directions, const PairScales& scales,
    const std::vector<double>& group_factor) {
  MeasuredBaselines measured(directions.size());
  for (size_t i = 0; i < directions.size(); ++i) {
    const int group = scales.group[i];
    if (group < 0) continue;
    const double unit = group_factor[group];
    const double length = scales.scale[i] * unit;
    measured[i] = {length * directions[i].direction,
                   scales.typical_depth * unit, group == 0};
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
                               const InitialPositions& initial) {
  return {MeasureBaselines(directions, scales, initial.group_factor),
          ComputeCameraCenters(problem, initial.positions)};
}

}  // namespace mgsfm

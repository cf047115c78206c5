// SPDX-License-Identifier: BSD-3-Clause
#include "translation/pair_consistency.h"

#include <algorithm>
#include <cstddef>

#include "mgsfm/base/mask.h"

namespace mgsfm {
namespace {

constexpr double kMinRelativeError = 0.5;
constexpr double kMinErrorInDepths = 0.25;

}  // namespace

Mask FindInconsistentPairs(const PositionProblem& problem,
                           const std::vector<BaselineDirection>& motions,
                           const PairScales& scales,
                           const InitialPositions& initial,
                           const Positions& positions) {
  Mask contradicts(motions.size(), false);
  for (size_t i = 0; i < motions.size(); ++i) {
    const BaselineDirection& motion = motions[i];
    if (!scales.pairs[i] ||
        !positions.IsPlaced(problem, motion.image_idx1) ||
        !positions.IsPlaced(problem, motion.image_idx2)) {
      continue;
    }
    const double unit = initial.group_factor[scales.pairs[i]->group];
    const double length = scales.pairs[i]->scale * unit;
    const Eigen::Vector3d baseline =
        positions.CamCenter(problem, motion.image_idx2) -
        positions.CamCenter(problem, motion.image_idx1);
    const double error = (baseline - length * motion.direction).norm();
    contradicts[i] =
        error > kMinRelativeError * std::max(length, baseline.norm()) &&
        error > kMinErrorInDepths * scales.typical_depth * unit;
  }
  return contradicts;
}

}  // namespace mgsfm

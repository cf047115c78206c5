// SPDX-License-Identifier: BSD-3-Clause
#include "rig_solver/point_minimization.h"

#include "rig_solver/rig_equations.h"

namespace mgsfm {

template <class R>
double RigEquations<R>::MinimizeTrialChunk(const ChunkRanges& chunk,
                                           double tolerance) {
  const auto function =
      HasAvx2() ? MinimizePointsAvx2<R> : MinimizePointsAny<R>;
  return function(
      {problem_, structure_, measured_, trial_poses_, trial_points_, lambda_},
      chunk, tolerance, &trial_points_);
}

template double RigEquations<PixelResidual>::MinimizeTrialChunk(
    const ChunkRanges&, double);
template double RigEquations<RayResidual>::MinimizeTrialChunk(
    const ChunkRanges&, double);

}  // namespace mgsfm

// SPDX-License-Identifier: BSD-3-Clause
#include "rig_solver/point_minimization.h"

#include "rig_solver/rig_equations.h"

namespace mgsfm {

template <class R>
double RigEquations<R>::MinimizeChunk(const ChunkRanges& chunk,
                                      double tolerance) {
  const auto function =
      HasAvx2() ? MinimizePointsAvx2<R> : MinimizePointsAny<R>;
  return function(Input(), chunk, tolerance, &points_);
}

template double RigEquations<PixelResidual>::MinimizeChunk(const ChunkRanges&,
                                                           double);
template double RigEquations<RayResidual>::MinimizeChunk(const ChunkRanges&,
                                                         double);

}  // namespace mgsfm

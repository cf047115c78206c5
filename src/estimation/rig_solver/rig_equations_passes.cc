// SPDX-License-Identifier: BSD-3-Clause
#include <algorithm>
#include <cstdint>

#include "base/cpu_features.h"
#include "base/ranges.h"
#include "rig_solver/residuals.h"
#include "rig_solver/rig_equations.h"
#include "rig_solver/schur_passes.h"

namespace mgsfm {
namespace {

template <class Problem>
std::vector<int> ImagesOf(const Problem& problem) {
  return Transformed(problem.observations,
                     [](const auto& o) { return o.image; });
}

}  // namespace

template <class R>
RigEquations<R>::RigEquations(const Problem& problem, ReducedSolver solver,
                              const Context& context)
    : RigEquationsBase(problem, ImagesOf(problem), solver, context) {
  measured_.reserve(R::kDim * problem.observations.size());
  for (const uint32_t o : structure_.observation_order) {
    const typename R::Scalar* values = R::Measured(problem.observations[o]);
    measured_.insert(measured_.end(), values, values + R::kDim);
  }
  structure_.observation_order = std::vector<uint32_t>();
  int num_params = 0;
  for (const RigProblemBase::Camera& camera : problem.cameras) {
    num_params =
        std::max(num_params, static_cast<int>(camera.free_params.size()));
  }
  kept_.num_values = R::kDim * (3 + static_cast<size_t>(num_params));
  if (!structure_.is_iterative) return;
  kept_.observations.resize(kept_.num_values * problem.observations.size());
}

template <class R>
double RigEquations<R>::CostOfChunk(const ChunkRanges& chunk) const {
  double cost = 0.0;
  for (size_t p = chunk.points.begin; p < chunk.points.end; ++p) {
    cost += CostOfPoint<R>(problem_, structure_, chunk, measured_, poses_, p,
                           points_[p].data());
  }
  return cost;
}

template <class R>
bool RigEquations<R>::LinearizeChunk(const ChunkRanges& chunk,
                                     SchurWorkspace* workspace) {
  const auto function =
      structure_.pose_size == 6
          ? (HasAvx2() ? LinearizeChunkAvx2<R, 6> : LinearizeChunkAny<R, 6>)
          : (HasAvx2() ? LinearizeChunkAvx2<R, 3> : LinearizeChunkAny<R, 3>);
  return function(Input(), chunk, &kept_, workspace);
}

template <class R>
StepSums RigEquations<R>::StepChunk(const ChunkRanges& chunk) {
  const auto function = HasAvx2() ? StepChunkAvx2<R> : StepChunkAny<R>;
  return function(Input(), {steps_, trial_poses_}, chunk, &trial_points_);
}

template <class R>
void RigEquations<R>::MultiplyChunk(const ChunkRanges& chunk,
                                    SchurWorkspace* workspace) {
  const auto function =
      structure_.pose_size == 6
          ? (HasAvx2() ? MultiplyChunkAvx2<R, 6> : MultiplyChunkAny<R, 6>)
          : (HasAvx2() ? MultiplyChunkAvx2<R, 3> : MultiplyChunkAny<R, 3>);
  function(Input(), &kept_, steps_, chunk, workspace);
}

template class RigEquations<PixelResidual>;
template class RigEquations<RayResidual>;

}  // namespace mgsfm

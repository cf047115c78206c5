// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <vector>

#include "math/robust_loss.h"
#include "mgsfm/base/context.h"
#include "mgsfm/base/mask.h"
#include "mgsfm/base/solver.h"
#include "translation_averaging/position_initialization.h"
#include "translation_averaging/track_points.h"

namespace mgsfm {

// The terms common to the refinements of positions, independent of the form of
// the residuals: the pairs that they use, and their weights.

struct RefinementOptions {
  int max_num_iterations = 50;
  RobustLossType loss = RobustLossType::kCauchy;
  double loss_scale_rad = 0.0;
  // The scale is then free; steps are damped, so it needs no gauge.
  bool starts_at_random = false;
  double function_tolerance = 1e-6;
  SolverBackend backend = SolverBackend::kNative;
};

// Results of the earlier stages. Without baselines, points determine
// everything.
struct RefinementInput {
  const PositionProblem& problem;
  const std::vector<BaselineDirection>& baselines;
  const PairScales& scales;
  const InitialPositions& initial;
  const Mask& pair_is_used;  // per baseline

  bool HasDirections() const { return !scales.group_sizes.empty(); }
  bool IsFree(int image_idx) const {
    return problem.sensor_kind[problem.sensor_idx[image_idx]] ==
           SensorKind::kFree;
  }
  // Whether a pair is used and of this kind, between placed images, and has a
  // baseline that is not constant.
  bool IsUsable(size_t pair_idx, BaselineKind kind,
                const Positions& positions) const;
  // The measured length of a kDirection pair in the unit of positions.
  double Length(size_t pair_idx) const {
    const PairScale& pair = *scales.pairs[pair_idx];
    return pair.scale * initial.group_factor[pair.group];
  }
  // Standard deviations of the direction, in radians, and of log(length).
  double DirectionSigma(size_t pair_idx) const;
  double LengthSigma(size_t pair_idx) const;
  double DirectionWeight(size_t pair_idx, double weight) const;
  // Weight of the logarithm of the length.
  double LengthWeight(size_t pair_idx) const;
  // Weight of baselines without parallax. It is small: these pairs only place
  // frames that nothing else constrains.
  double ZeroBaselineWeight() const;
};

// Weight of the directions of pairs beside points. The matches of a pair are
// observations of points, so full weight would count them twice. Half or twice
// the value changes errors by at most 2 % (docs/results/constants.md).
constexpr double kPairWeightWithPoints = 0.1;
// The length of a baseline is smoothed below this fraction of its measured
// length, where its direction is undefined.
constexpr double kMinRelativeLength = 1e-4;

// The loss of the refinement without points is annealed: its scale is
// multiplied by these factors. 16 as first factor, or no annealing, changes
// errors by at most 1.3 % (docs/results/constants.md).
constexpr double kLossAnnealing[] = {8.0, 2.0, 1.0};
// Iterations of a refinement that starts another one. Half and twice the number
// change errors by at most 1.3 % (docs/results/constants.md).
constexpr int kNumCoarseIterations = 10;

// Whether there is enough data to refine positions and points.
bool IsDetermined(const RefinementInput& input,
                  const std::vector<size_t>& track_idxs);

// The summary of an unnecessary solve.
SolveSummary NothingToDo(const char* message);

// An objective for positions: refines positions alone, and with points. A null
// function omits that refinement.
struct PositionObjective {
  SolveSummary (*refine_cameras)(const RefinementInput& input,
                                 const RefinementOptions& options,
                                 const Context& context, Positions* positions);
  SolveSummary (*refine_cameras_and_points)(
      const RefinementInput& input, const TrackRays& rays,
      const std::vector<size_t>& track_idxs, const RefinementOptions& options,
      const Context& context, PositionsAndPoints* placed);
};

}  // namespace mgsfm

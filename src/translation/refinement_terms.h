// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <vector>

#include "math/robust_loss.h"
#include "mgsfm/base/context.h"
#include "mgsfm/base/summary.h"
#include "mgsfm/least_squares/backend.h"
#include "translation/position_initialization.h"
#include "translation/track_points.h"

namespace mgsfm {

// What the refinements have in common, whatever the form of their residuals:
// which pairs they use, and how certain they take them for.

struct RefinementOptions {
  int max_num_iterations = 50;
  RobustLossType loss = RobustLossType::kCauchy;
  double loss_scale_rad = 0.0;
  // Then the scale must be free to change; steps are damped, so it needs no
  // gauge.
  bool starts_at_random = false;
  double function_tolerance = 1e-6;
  SolverBackend backend = SolverBackend::kNative;
};

// What refinements need of the stages before. Without motions, points tell all.
struct RefinementInput {
  const PositionProblem& problem;
  const std::vector<BaselineDirection>& motions;
  const PairScales& scales;
  const InitialPositions& initial;

  bool HasDirections() const { return !scales.group_sizes.empty(); }
  bool IsFree(int image_idx) const {
    return problem.sensor_kind[problem.sensor_idx[image_idx]] ==
           SensorKind::kFree;
  }
  // Of that kind, between placed images, with a baseline that is not constant.
  bool IsUsable(const BaselineDirection& motion, BaselineKind kind,
                const Positions& positions) const;
  // The measured length of a pair in the unit of positions.
  double Length(size_t motion_idx) const {
    return scales.scale[motion_idx] *
           initial.group_factor[scales.group[motion_idx]];
  }
  double DirectionWeight(size_t motion_idx, double weight) const;
  // Of the logarithm of the length.
  double LengthWeight(size_t motion_idx) const;
  // Of baselines without parallax: weak, only to place what nothing else does.
  double ZeroBaselineWeight() const;
};

// Of directions of pairs, where points are refined along.
constexpr double kPairWeightWithPoints = 0.1;
// Baselines shorter than this, of their measured length, are as if so long.
constexpr double kMinRelativeLength = 1e-4;

// The loss of cameras alone is annealed: its scale is multiplied by these.
// Solves but the last have kNumCoarseRefinements iterations.
constexpr double kLossAnnealing[] = {8.0, 2.0, 1.0};
constexpr int kNumCoarseRefinements = 10;

// There is enough to refine positions and points with.
bool IsDetermined(const RefinementInput& input,
                  const std::vector<size_t>& track_idxs);

SolveSummary NothingToDo(const char* message);

// An objective for positions: refines all but the points, and all.
struct PositionObjective {
  SolveSummary (*refine_cameras)(const RefinementInput& input,
                                 const RefinementOptions& options,
                                 const Context& context, Positions* positions);
  SolveSummary (*refine_cameras_and_points)(
      const RefinementInput& input, const TrackRays& rays,
      const std::vector<size_t>& track_idxs, const RefinementOptions& options,
      const Context& context, Positions* positions, TrackPoints* points);
};

}  // namespace mgsfm

// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <functional>
#include <vector>

#include "geometry/so3.h"
#include "math/robust_loss.h"
#include "mgsfm/base/context.h"
#include "mgsfm/base/mask.h"
#include "mgsfm/base/solver.h"
#include "mgsfm/scene/estimates.h"
#include "mgsfm/scene/scene.h"
#include "mgsfm/scene/view_graph.h"
#include "mgsfm/translation_averaging/translation_averaging.h"
#include "translation_averaging/baseline_directions.h"
#include "translation_averaging/position_initialization.h"
#include "translation_averaging/position_problem.h"
#include "translation_averaging/scale_averaging.h"
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

// Refines frame centers and sensor translations by eq. (16) of MGSfM,
//
//   min sum_p rho(w_p |b_p - C_p / |C_p||),
//
// with the directions b_p and baselines C_p of pairs, a Cauchy loss rho whose
// scale is annealed to loss_scale_rad, and terms w log(|C_p| / s_p) that keep
// the measured lengths s_p, which directions do not determine on straight
// motion. Gauge: the first frame is constant; the s_p determine the unit of
// length. Levenberg-Marquardt (rig_solver/rig_solver.h); stops when the
// relative decrease of the cost is below function_tolerance.
SolveSummary RefineCameras(const RefinementInput& input,
                           const RefinementOptions& options,
                           const Context& context, Positions* positions);

// Refines centers, translations and points p_k by eq. (18) of MGSfM,
//
//   min sum_ik rho(|g_ik - (p_k - c_i) / |p_k - c_i||) + pairs,
//
// over the used observations of the tracks track_idxs, with rays g in world
// axes. The pair terms above have a tenth of their weight and no lengths; they
// constrain frames with too few points. Gauge: the first frame is constant, and
// the farthest unknown keeps its length unless known sensor offsets determine
// the unit. Points are eliminated (Schur complement).
SolveSummary RefineCamerasAndPoints(const RefinementInput& input,
                                    const TrackRays& rays,
                                    const std::vector<size_t>& track_idxs,
                                    const RefinementOptions& options,
                                    const Context& context,
                                    PositionsAndPoints* placed);

constexpr PositionObjective kNonBilinearObjective = {RefineCameras,
                                                     RefineCamerasAndPoints};

// The stages of AverageTranslations()
// (mgsfm/translation_averaging/translation_averaging.h), from known rotations
// to positions and points.

// Stopping criterion of L1 positions before a refinement. A value ten times
// tighter would not improve the start: the first step of the refinement removes
// errors along long bends.
constexpr double kStartTolerance = 1e-3;
// Errors of positions from pairs alone, before points are used: some degrees of
// error in the direction to a point. Half or twice the value changes errors by
// at most 2 % (docs/results/constants.md).
constexpr double kCoarseErrorRad = DegToRad(4.0);

// Directions (baseline_directions.h) and relative lengths (scale_averaging.h)
// of the baselines of pairs.
struct PairMeasurements {
  std::vector<BaselineDirection> baselines;  // without depths
  PairScales scales;
};

PairMeasurements MeasurePairs(const BaselineInput& input,
                              double min_parallax_deg, const Context& context,
                              const LengthHints& hints);

// Counts the kinds of pairs and the groups of scales.
void SummarizePairs(const PairMeasurements& pairs, const Mask& pair_is_used,
                    TranslationSummary* summary);

// Positions from the directions of pairs alone (RefineCameras),
// starting at input.initial. Without a usable solution, the result is the
// start.
struct RefinedPositions {
  Positions positions;
  SolveSummary solve;
};
RefinedPositions RefineWithPairs(
    const RefinementInput& input, const TranslationAveragingOptions& options,
    const Context& context,
    const PositionObjective& objective = kNonBilinearObjective);

// Triangulates the points of placed->positions again. The lower bound of their
// depth is a fraction of the typical depth of input.scales.
void TriangulateAgain(const RefinementInput& input, const TrackRays& rays,
                      double max_error_rad,
                      const TranslationAveragingOptions& options,
                      int num_threads, PositionsAndPoints* placed);

// Positions and points from all rays: a coarse triangulation and joint
// refinement by eq. (18) of MGSfM, then triangulation and refinement at the
// noise level of the rays. Points place the frames without usable pairs in
// between. An objective without points only triangulates coarsely.
struct TrackRefinement {
  PositionsAndPoints placed;
  SolveSummary solve;  // of the last refinement
  int num_frames_placed_by_points = 0;
};
TrackRefinement RefineWithTracks(
    const RefinementInput& input, const Positions& start, const TrackRays& rays,
    const TranslationAveragingOptions& options, const Context& context,
    const PositionObjective& objective = kNonBilinearObjective);

// The factor that returns positions to the measured lengths of the used pairs.
// Angles do not determine the common scale, so it drifts in refinements.
double FactorToMeasuredLengths(const RefinementInput& input,
                               const Positions& positions);

void ScaleBy(double factor, PositionsAndPoints* placed);

PositionEstimate MakePositionEstimate(const Scene& scene,
                                      const PositionProblem& problem,
                                      const PositionsAndPoints& placed);

// Counts placed frames and points, and describes each sensor.
void SummarizeEstimate(const PositionProblem& problem,
                       const InitialPositions& initial,
                       const PositionEstimate& estimate,
                       TranslationSummary* summary);

// The measurements and estimates of the stages so far.
struct TranslationState {
  PositionProblem problem;
  PairMeasurements pairs;
  InitialPositions initial;
  Mask pair_is_used;  // by the next stage
  PositionsAndPoints placed;

  InitializationInput ToInitialize() const {
    return {problem, pairs.baselines, pairs.scales, pair_is_used};
  }
  RefinementInput ToRefine() const {
    return {problem, pairs.baselines, pairs.scales, initial, pair_is_used};
  }
};

// Functions that a caller adds to the stages of AverageTranslations(): the
// rules of pair filtering (translation_averaging/position_estimation.h), or
// another objective (baselines/position_baselines.h). Null functions do
// nothing.
struct TranslationHooks {
  LengthHints length_hints = {};
  PositionObjective objective = kNonBilinearObjective;
  // Replaces stage 2: finds `initial`, and removes used pairs.
  std::function<void(TranslationState*)> initialize = {};
  // Removes used pairs after stage 3, if the objective has that stage.
  std::function<void(TranslationState*)> select_pairs = {};
  // Called with positions as they improve, and points that these triangulate.
  std::function<void(const PositionEstimate&)> observer = {};
  // Receives the state after the last stage.
  std::function<void(TranslationState)> finish = {};
};

}  // namespace mgsfm

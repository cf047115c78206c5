// SPDX-License-Identifier: BSD-3-Clause
#include "baselines/position_baselines.h"

#include <algorithm>
#include <utility>
#include <vector>

#include "baselines/bilinear_refinement.h"
#include "baselines/random_start.h"
#include "geometry/so3.h"
#include "math/statistics.h"
#include "mgsfm/base/error.h"
#include "translation_averaging/translation_stages.h"

namespace mgsfm {
namespace {

// The loss, iterations and tolerance of global positioning (GLOMAP).
constexpr double kRandomStartLossRad = 0.1;
constexpr int kNumRandomStartIterations = 100;
constexpr double kFunctionTolerance = 1e-5;

PositionObjective ObjectiveOf(const PositionBaselineOptions& baseline) {
  if (baseline.objective == TranslationObjective::kDistance) return {};
  PositionObjective objective =
      baseline.objective == TranslationObjective::kBilinear
          ? kBilinearObjective
          : kNonBilinearObjective;
  if (baseline.input == TranslationSource::kRelativeTranslations) {
    objective.refine_cameras_and_points = nullptr;
  }
  return objective;
}

// The factor that makes the median baseline of the used pairs 1.
double FactorToUnitBaseline(const PositionInput& input,
                            const PositionProblem& problem,
                            const Positions& positions) {
  std::vector<double> baselines;
  for (size_t i = 0; i < input.view_graph.pairs.size(); ++i) {
    const ImagePair& pair = input.view_graph.pairs[i];
    if (!input.rotations.pair_is_inlier[i] ||
        !positions.IsPlaced(problem, pair.image_idx1) ||
        !positions.IsPlaced(problem, pair.image_idx2)) {
      continue;
    }
    baselines.push_back((positions.CamCenter(problem, pair.image_idx2) -
                         positions.CamCenter(problem, pair.image_idx1))
                            .norm());
  }
  if (baselines.empty()) return 1.0;
  const double median = Median(std::move(baselines));
  return median > 0.0 ? 1.0 / median : 1.0;
}

// Global positioning: one joint refinement from a random start, without pairs.
PositionResult PositionByTracks(const PositionBaselineOptions& baseline,
                                const PositionInput& input,
                                const PositionOptions& options,
                                const Context& context) {
  const PositionProblem problem =
      MakePositionProblem(input.scene, input.rotations);
  const TrackRays rays = ComputeTrackRays(problem, input.bearings, input.tracks,
                                          context.num_threads);
  const RandomStart start = StartAtRandom(problem, rays, context.random_seed);
  const PairMeasurements no_pairs;
  const Mask no_pair_is_used;
  const RefinementInput refinement{problem, no_pairs.baselines, no_pairs.scales,
                                   start.initial, no_pair_is_used};
  RefinementOptions refinement_options;
  refinement_options.loss = RobustLossType::kHuber;
  refinement_options.loss_scale_rad = kRandomStartLossRad;
  refinement_options.starts_at_random = true;
  // The damping of the native solver falls too fast for states that are far
  // from a solution. Sums in Ceres depend on the number of threads.
  refinement_options.backend = SolverBackend::kCeres;
  Context one_thread = context;
  one_thread.num_threads = 1;
  refinement_options.function_tolerance = kFunctionTolerance;
  refinement_options.max_num_iterations =
      std::max(kNumRandomStartIterations, options.averaging.max_num_iterations);
  PositionsAndPoints placed{start.initial.positions, start.points};
  PositionResult result;
  TranslationSummary& summary = result.summary;
  summary.joint_refinement = ObjectiveOf(baseline).refine_cameras_and_points(
      refinement, rays,
      SelectTracks(rays, placed.points,
                   static_cast<int>(problem.frame_idx.size()),
                   options.averaging.min_num_points_per_image),
      refinement_options, one_thread, &placed);
  if (!summary.joint_refinement.IsUsable()) {
    placed = {start.initial.positions, start.points};
  }
  TriangulateAgain(refinement, rays,
                   2.0 * DegToRad(options.averaging.max_angle_error_deg),
                   options.averaging, context.num_threads, &placed);
  if (!start.initial.is_metric) {
    ScaleBy(FactorToUnitBaseline(input, problem, placed.positions), &placed);
  }
  result.pair_is_inconsistent.assign(input.view_graph.pairs.size(), false);
  result.pair_is_beyond_drift_bound = result.pair_is_inconsistent;
  result.estimate = MakePositionEstimate(input.scene, problem, placed);
  summary.initialization = start.initial.solve;
  summary.camera_refinement = NothingToDo("Not needed: points determine all.");
  SummarizeEstimate(problem, start.initial, result.estimate, &summary);
  return result;
}

}  // namespace

void CheckPositionBaseline(const PositionBaselineOptions& options) {
  const bool is_relative =
      options.input == TranslationSource::kRelativeTranslations ||
      options.input == TranslationSource::kAuto;
  if (options.objective == TranslationObjective::kDistance && !is_relative) {
    throw Error(
        "TranslationAveraging.objective 'distance' uses relative translations "
        "only; omit TranslationAveraging.input, or choose another objective");
  }
}

PositionResult EstimatePositionsByBaseline(
    const PositionBaselineOptions& baseline, const PositionInput& input,
    const PositionOptions& options, const Context& context) {
  CheckPositionBaseline(baseline);
  return baseline.input == TranslationSource::kTracks
             ? PositionByTracks(baseline, input, options, context)
             : EstimatePositionsBy(ObjectiveOf(baseline), input, options,
                                   context);
}

}  // namespace mgsfm

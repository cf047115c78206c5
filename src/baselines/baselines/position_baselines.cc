// SPDX-License-Identifier: BSD-3-Clause
#include "baselines/position_baselines.h"

#include <algorithm>
#include <utility>
#include <vector>

#include "base/random.h"
#include "baselines/bilinear_refinement.h"
#include "geometry/so3.h"
#include "math/statistics.h"
#include "mgsfm/base/error.h"
#include "translation_averaging/position_initialization.h"
#include "translation_averaging/track_points.h"
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

// Half of the sides of the cubes.
constexpr double kHalfWidth = 100.0;
constexpr double kSensorHalfWidth = 1.0;

Eigen::Vector3d RandomPosition(double half_width, Random* random) {
  Eigen::Vector3d position;
  for (int i = 0; i < 3; ++i) {
    position[i] = random->Uniform(-half_width, half_width);
  }
  return position;
}

TrackPoints RandomPoints(const TrackRays& rays, Random* random) {
  TrackPoints points;
  points.point_in_world.resize(rays.tracks.size());
  points.observation_is_used.assign(rays.tracks.observations.size(), false);
  for (size_t t = 0; t < rays.tracks.size(); ++t) {
    const size_t begin = rays.tracks.offsets[t];
    const size_t end = rays.tracks.offsets[t + 1];
    int num_rays = 0;
    for (size_t k = begin; k < end; ++k) {
      num_rays += rays.has_ray[k] ? 1 : 0;
    }
    const Eigen::Vector3d position = RandomPosition(kHalfWidth, random);
    if (num_rays < 2) continue;
    points.point_in_world[t] = position;
    for (size_t k = begin; k < end; ++k) {
      points.observation_is_used[k] = rays.has_ray[k];
    }
  }
  return points;
}

// The start of global positioning (GLOMAP): frame centers and points are
// uniform in a cube of side 200, translations of free sensors in a cube of
// side 2. Tracks with at least two rays have a point, and all their rays are
// used; the frames that observe them are placed.
struct RandomStart {
  InitialPositions initial;
  TrackPoints points;
};

RandomStart StartAtRandom(const PositionProblem& problem, const TrackRays& rays,
                          uint64_t seed) {
  RandomStart start;
  Random random(seed);
  Positions& positions = start.initial.positions;
  positions.frame_is_placed.assign(problem.num_frames, false);
  for (int f = 0; f < problem.num_frames; ++f) {
    positions.frame_center.push_back(RandomPosition(kHalfWidth, &random));
  }
  positions.sensor_translation = problem.fixed_translation;
  start.initial.is_metric = problem.HasKnownOffset();
  for (size_t s = 0; s < problem.sensor_kind.size(); ++s) {
    if (problem.sensor_kind[s] != SensorKind::kFree) continue;
    positions.sensor_translation[s] = RandomPosition(kSensorHalfWidth, &random);
    start.initial.free_sensors.push_back(static_cast<int>(s));
  }
  start.initial.unobservable.resize(0, 3 * start.initial.free_sensors.size());
  start.initial.solve.termination = Termination::kConverged;
  start.initial.solve.message = "Not needed: positions start at random.";
  start.points = RandomPoints(rays, &random);
  for (size_t k = 0; k < rays.tracks.observations.size(); ++k) {
    if (!start.points.observation_is_used[k]) continue;
    const int image_idx = rays.tracks.observations[k].image_idx;
    positions.frame_is_placed[problem.frame_idx[image_idx]] = true;
  }
  return start;
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

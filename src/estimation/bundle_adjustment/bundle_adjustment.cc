// SPDX-License-Identifier: BSD-3-Clause
#include "mgsfm/bundle_adjustment/bundle_adjustment.h"

#include <algorithm>
#include <cmath>
#include <utility>

#include "base/ranges.h"
#include "bundle_adjustment/point_filters.h"
#include "bundle_adjustment/problem_builder.h"
#include "bundle_adjustment/solve.h"
#include "geometry/so3.h"
#include "math/statistics.h"
#include "mgsfm/base/mask.h"
#include "rig_solver/rig_solver.h"

namespace mgsfm {
namespace {

SolveSummary SolveProblem(const BundleAdjustmentOptions& options,
                          bool minimizes_points, const Context& context,
                          BuiltProblem* built) {
  RigSolverOptions solver_options;
  solver_options.backend = options.backend;
  solver_options.max_num_iterations = options.max_num_iterations;
  solver_options.function_tolerance = options.function_tolerance;
  solver_options.minimizes_points =
      minimizes_points || AnyOf(built->problem.cameras, [](const auto& camera) {
        return !camera.free_params.empty();
      });
  if (options.saves_memory) {
    solver_options.reduced_solver = ReducedSolver::kIterative;
  }
  RigSolver<PixelObservation> solver(built->problem, solver_options, context);
  // The native solver copies the problem into its own layout.
  if (options.backend == SolverBackend::kNative) {
    built->problem.observations = std::vector<PixelObservation>();
    built->problem.point_begin = std::vector<size_t>{0};
  }
  return solver.Solve(solver_options.max_num_iterations, &built->state);
}

}  // namespace

bool SolveOnce(const Scene& scene, const RefinementConditions& conditions,
               const BundleAdjustmentOptions& options, SolveMode mode,
               const Context& context, BundleResult* result) {
  BuiltProblem built =
      BuildProblem(scene, result->estimate, options, mode.parts,
                   conditions.priors, conditions.fixed);
  SolveSummary summary =
      SolveProblem(options, mode.minimizes_points, context, &built);
  const bool is_usable = summary.IsUsable();
  if (is_usable) WriteBack(built, &result->estimate);
  result->summary.num_invisible_observations = built.num_invisible_observations;
  result->summary.solves.push_back(std::move(summary));
  return is_usable;
}

PointFilterOptions MakeFilterOptions(const Scene& scene,
                                     const Reconstruction& estimate,
                                     const BundleAdjustmentOptions& options,
                                     double max_error_px,
                                     const Context& context) {
  PointFilterOptions filter;
  filter.max_error_px = max_error_px;
  filter.min_num_observations = options.min_num_observations;
  filter.min_angle_rad = DegToRad(options.min_triangulation_angle_deg);
  filter.min_two_view_angle_rad = DegToRad(options.min_two_view_angle_deg);
  filter.min_group_share = options.min_track_share;
  const std::vector<double> distances =
      PointDistances(scene, estimate, context.num_threads);
  if (distances.empty()) return filter;
  const double median_distance = Median(distances);
  if (!std::isfinite(median_distance)) return filter;
  filter.min_two_view_distance =
      options.min_two_view_relative_distance * median_distance;
  if (options.max_relative_distance > 0.0) {
    filter.max_distance = options.max_relative_distance * median_distance;
  }
  if (options.max_relative_distance_of_one_image > 0.0) {
    filter.max_distance_of_one_image =
        options.max_relative_distance_of_one_image * median_distance;
    filter.sensor_measures_distances = FindSensorsThatMeasure(
        scene, estimate, distances, filter.max_distance_of_one_image);
  }
  return filter;
}

double MaxErrorPx(const BundleAdjustmentOptions& options, double sigma_px,
                  int num_rounds_left) {
  const double largest = std::ldexp(options.max_max_error_px, num_rounds_left);
  return std::min(largest, std::max(options.min_max_error_px,
                                    options.error_sigma_factor * sigma_px));
}

double MaxRmsErrorPx(const BundleAdjustmentOptions& options, double sigma_px) {
  return options.error_sigma_factor * std::max(kMinKeypointSigmaPx, sigma_px);
}

double LossScalePx(const BundleAdjustmentOptions& options, double sigma_px) {
  return std::min(
      options.loss_scale_px,
      std::max(kMinKeypointSigmaPx, options.loss_sigma_factor * sigma_px));
}

void FinishSummary(const Scene& scene, const Reconstruction& initial,
                   const BundleAdjustmentOptions& options,
                   BundleResult* result) {
  std::vector<int> num_of_frame(scene.frames.size(), 0);
  Mask sensor_is_seen(scene.sensors.size(), false);
  for (const Point3D& point : result->estimate.points) {
    for (const Observation& o : point.track) {
      if (!initial.IsRegistered(scene, o.image_idx)) continue;
      ++num_of_frame[scene.images[o.image_idx].frame_idx];
      sensor_is_seen[scene.images[o.image_idx].sensor_idx] = true;
    }
  }
  result->summary.weak_frame_idxs.clear();
  result->summary.sensor_idxs_without_observations.clear();
  for (size_t i = 0; i < scene.frames.size(); ++i) {
    if (!result->estimate.rig_from_world[i]) continue;
    if (num_of_frame[i] < options.min_num_observations_per_frame) {
      result->summary.weak_frame_idxs.push_back(static_cast<int>(i));
    }
  }
  for (size_t i = 0; i < scene.sensors.size(); ++i) {
    if (!sensor_is_seen[i]) {
      result->summary.sensor_idxs_without_observations.push_back(
          static_cast<int>(i));
    }
  }
}

BundleResult AdjustBundle(const Scene& scene, const Reconstruction& initial,
                          const BundleAdjustmentOptions& options,
                          const Context& context, const BundlePriors& priors,
                          const FixedPoses& fixed) {
  BundleResult result;
  result.estimate = initial;
  SolveOnce(scene, {priors, fixed}, options, {}, context, &result);
  ComputePointErrors(scene, context.num_threads, &result.estimate);
  FinishSummary(scene, initial, options, &result);
  return result;
}

}  // namespace mgsfm

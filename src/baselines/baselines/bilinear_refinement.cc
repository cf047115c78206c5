// SPDX-License-Identifier: BSD-3-Clause
#include "baselines/bilinear_refinement.h"

#include <ceres/problem.h>
#include <ceres/solver.h>

#include <Eigen/Core>
#include <algorithm>

#include "baselines/bilinear_costs.h"
#include "rig_solver/ceres_solving.h"

namespace mgsfm {
namespace {

using Eigen::Matrix3d;
using Eigen::Vector3d;

// Lower bound of scales, which keeps points in front of cameras (GLOMAP).
constexpr double kMinScale = 1e-5;
// Differences shorter than this start with the scale of this length.
constexpr double kMinLength = 1e-9;

ceres::Problem::Options ProblemOptions() {
  ceres::Problem::Options options;
  options.loss_function_ownership = ceres::DO_NOT_TAKE_OWNERSHIP;
  return options;
}

// The problem over the values of `positions` and `points`, which are its
// parameter blocks. Terms and points are added first, then the gauge is fixed.
class BilinearProblem {
 public:
  BilinearProblem(const RefinementInput& input,
                  const RefinementOptions& options, size_t max_num_scales,
                  Positions* positions)
      : input_(input),
        options_(options),
        initial_(*positions),
        positions_(*positions),
        loss_({options.loss, options.loss_scale_rad}),
        problem_(ProblemOptions()) {
    scales_.reserve(max_num_scales);  // the addresses must not change
  }

  void AddDirections(double weight, bool with_lengths) {
    for (size_t i = 0; i < input_.baselines.size(); ++i) {
      if (!input_.IsUsable(i, BaselineKind::kDirection, initial_)) continue;
      const double length = input_.Length(i);
      double* scale =
          AddScaled(Baseline(i), input_.baselines[i].direction,
                    input_.DirectionWeight(i, weight),
                    std::max(kMinRelativeLength * length, kMinLength));
      if (!with_lengths) continue;
      problem_.AddResidualBlock(new LengthCost(length, input_.LengthWeight(i)),
                                &loss_, scale);
    }
  }

  void AddZeroBaselines() {
    for (size_t i = 0; i < input_.baselines.size(); ++i) {
      if (!input_.IsUsable(i, BaselineKind::kNoParallax, initial_)) continue;
      const LinearDifference baseline = Baseline(i);
      problem_.AddResidualBlock(
          new DifferenceCost(baseline, input_.ZeroBaselineWeight()), &loss_,
          baseline.Blocks());
    }
  }

  void AddTrack(const TrackRays& rays, size_t track_idx, TrackPoints* points) {
    Vector3d& point = *points->point_in_world[track_idx];
    for (size_t k = rays.tracks.offsets[track_idx];
         k < rays.tracks.offsets[track_idx + 1]; ++k) {
      if (!points->observation_is_used[k]) continue;
      LinearDifference difference;
      AddCenter(rays.tracks.observations[k].image_idx, -1.0, &difference);
      difference.Add(point.data(), Matrix3d::Identity());
      AddScaled(difference, rays.rays_in_world[k], 1.0, kMinLength);
    }
  }

  void FixGauge() {
    for (size_t f = 0; f < positions_.frame_center.size(); ++f) {
      double* center = positions_.frame_center[f].data();
      if (!initial_.frame_is_placed[f] || !problem_.HasParameterBlock(center)) {
        continue;
      }
      problem_.SetParameterBlockConstant(center);
      break;
    }
    const Eigen::MatrixXd& rows = input_.initial.unobservable;
    std::vector<double*> blocks;
    for (const int s : input_.initial.free_sensors) {
      blocks.push_back(positions_.sensor_translation[s].data());
    }
    for (Eigen::Index k = 0; k < rows.rows(); ++k) {
      std::vector<Vector3d> row;
      for (size_t s = 0; s < blocks.size(); ++s) {
        row.emplace_back(
            rows.row(k).segment<3>(3 * static_cast<Eigen::Index>(s)));
      }
      problem_.AddResidualBlock(
          new RowCost(std::move(row), 1.0 / input_.initial.group_factor[0]),
          nullptr, blocks);
    }
  }

  SolveSummary Solve(double loss_scale_rad, int max_num_iterations,
                     const Context& context) {
    SolveSummary summary;
    if (problem_.NumResidualBlocks() == 0) {
      summary.termination = Termination::kConverged;
      summary.message = "There is nothing to solve.";
      return summary;
    }
    loss_.SetScale(loss_scale_rad);
    ceres::Solver::Options options;
    options.linear_solver_type = ceres::SPARSE_NORMAL_CHOLESKY;
    options.max_num_iterations = max_num_iterations;
    options.function_tolerance = options_.function_tolerance;
    options.parameter_tolerance = 1e-10;
    options.gradient_tolerance = 1e-16;
    options.num_threads = 1;
    options.logging_type = ceres::SILENT;
    StopWhenCanceled callback(context);
    options.callbacks.push_back(&callback);
    ceres::Solver::Summary result;
    ceres::Solve(options, &problem_, &result);
    context.CheckInterrupted();
    return SummarizeCeres(result);
  }

 private:
  // Adds sign times the camera center c^g - R^T t.
  void AddCenter(int image_idx, double sign, LinearDifference* difference) {
    const PositionProblem& problem = input_.problem;
    const int sensor = problem.sensor_idx[image_idx];
    const Matrix3d by_sensor = -sign * *problem.world_from_cam[image_idx];
    difference->Add(
        positions_.frame_center[problem.frame_idx[image_idx]].data(),
        sign * Matrix3d::Identity());
    if (input_.IsFree(image_idx)) {
      difference->Add(positions_.sensor_translation[sensor].data(), by_sensor);
    } else {
      difference->offset += by_sensor * positions_.sensor_translation[sensor];
    }
  }

  LinearDifference Baseline(size_t pair_idx) {
    LinearDifference baseline;
    AddCenter(input_.baselines[pair_idx].image_idx1, -1.0, &baseline);
    AddCenter(input_.baselines[pair_idx].image_idx2, 1.0, &baseline);
    return baseline;
  }

  // Returns the scale.
  double* AddScaled(const LinearDifference& difference,
                    const Vector3d& direction, double weight,
                    double min_length) {
    const double start =
        options_.starts_at_random
            ? 1.0
            : 1.0 / std::max(difference.Value().norm(), min_length);
    scales_.push_back(std::max(start, kMinScale));
    double* scale = &scales_.back();
    std::vector<double*> blocks = difference.Blocks();
    blocks.push_back(scale);
    problem_.AddResidualBlock(new DifferenceCost(difference, direction, weight),
                              &loss_, blocks);
    problem_.SetParameterLowerBound(scale, 0, kMinScale);
    return scale;
  }

  const RefinementInput& input_;
  const RefinementOptions& options_;
  const Positions initial_;
  Positions& positions_;
  std::vector<double> scales_;
  CeresLoss loss_;
  ceres::Problem problem_;
};

}  // namespace

SolveSummary RefineCamerasBilinearly(const RefinementInput& input,
                                     const RefinementOptions& options,
                                     const Context& context,
                                     Positions* positions) {
  if (!input.HasDirections()) return NothingToDo("No pair has parallax.");
  BilinearProblem problem(input, options, input.baselines.size(), positions);
  problem.AddDirections(1.0, true);
  problem.AddZeroBaselines();
  problem.FixGauge();
  SolveSummary summary;
  for (const double factor : kLossAnnealing) {
    summary = problem.Solve(
        factor * options.loss_scale_rad,
        factor > 1.0 ? kNumCoarseIterations : options.max_num_iterations,
        context);
    if (!summary.IsUsable()) break;
  }
  return summary;
}

SolveSummary RefineCamerasAndPointsBilinearly(
    const RefinementInput& input, const TrackRays& rays,
    const std::vector<size_t>& track_idxs, const RefinementOptions& options,
    const Context& context, PositionsAndPoints* placed) {
  if (!IsDetermined(input, track_idxs)) return NothingToDo("Too few points.");
  BilinearProblem problem(
      input, options, input.baselines.size() + rays.tracks.observations.size(),
      &placed->positions);
  for (const size_t t : track_idxs) {
    problem.AddTrack(rays, t, &placed->points);
  }
  problem.AddDirections(kPairWeightWithPoints, false);
  problem.FixGauge();
  return problem.Solve(options.loss_scale_rad, options.max_num_iterations,
                       context);
}

}  // namespace mgsfm

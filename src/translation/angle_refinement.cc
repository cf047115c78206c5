// SPDX-License-Identifier: BSD-3-Clause
#include "translation/angle_refinement.h"

#include <ceres/loss_function.h>
#include <ceres/problem.h>
#include <ceres/solver.h>

#include <algorithm>
#include <cmath>
#include <memory>

#include "mgsfm/geometry/so3.h"
#include "translation/angle_costs.h"

namespace mgsfm {
namespace {

using Eigen::Matrix3d;
using Eigen::Vector3d;

// Errors of pairs that remain whatever their own estimates say.
constexpr double kDirectionSigma = DegToRad(0.5);
constexpr double kScaleSigma = 0.1;
constexpr double kMinRelativeLength = 1e-4;
constexpr double kPairWeightWithPoints = 0.1;
constexpr size_t kMinNumPoints = 10;

class AngleProblem {
 public:
  AngleProblem(const RefinementInput& input,
               const AngleRefinementOptions& options, Positions* positions)
      : input_(input),
        options_(options),
        positions_(positions),
        loss_(new ceres::CauchyLoss(options.loss_scale_rad),
              ceres::TAKE_OWNERSHIP),
        problem_(ProblemOptions()) {}

  void AddDirections(double weight);
  void AddLengths();
  void AddZeroBaselines(double weight);
  void AddPoints(const TrackRays& rays, const std::vector<size_t>& track_idxs,
                 TrackPoints* points);
  void AddGauge();
  void AddScaleGauge();
  void SetLossScale(double scale_rad) {
    loss_.Reset(new ceres::CauchyLoss(scale_rad), ceres::TAKE_OWNERSHIP);
  }
  SolveSummary Solve(ceres::LinearSolverType solver_type, int max_iterations);

 private:
  static ceres::Problem::Options ProblemOptions() {
    ceres::Problem::Options options;
    options.loss_function_ownership = ceres::DO_NOT_TAKE_OWNERSHIP;
    return options;
  }
  // The baseline of a pair with the blocks it depends on; none if it is
  // constant.
  LinearBaseline MakeBaseline(const PairMotion& motion,
                              std::vector<double*>* blocks) const;
  // The factor from units of scales.scale to those of positions.
  double Length(size_t motion_idx) const {
    return input_.scales.scale[motion_idx] *
           input_.initial.group_factor[input_.scales.group[motion_idx]];
  }
  bool IsUsable(const PairMotion& motion, PairKind kind) const {
    return motion.kind == kind &&
           positions_->IsPlaced(input_.problem, motion.image_idx1) &&
           positions_->IsPlaced(input_.problem, motion.image_idx2);
  }
  void AddObservation(int image_idx, const Vector3d& ray, double* point);

  const RefinementInput& input_;
  const AngleRefinementOptions options_;
  Positions* positions_;
  ceres::LossFunctionWrapper loss_;
  ceres::Problem problem_;
  std::vector<double*> point_blocks_;
};

LinearBaseline AngleProblem::MakeBaseline(const PairMotion& motion,
                                          std::vector<double*>* blocks) const {
  LinearBaseline baseline;
  const auto add = [&](double* block, const Matrix3d& coefficients) {
    const auto it = std::find(blocks->begin(), blocks->end(), block);
    if (it != blocks->end()) {
      baseline.coefficients[it - blocks->begin()] += coefficients;
      return;
    }
    baseline.coefficients[baseline.num_blocks++] = coefficients;
    blocks->push_back(block);
  };
  const PositionProblem& problem = input_.problem;
  const int images[2] = {motion.image_idx1, motion.image_idx2};
  const bool is_one_frame =
      problem.frame_idx[images[0]] == problem.frame_idx[images[1]];
  for (int side = 0; side < 2; ++side) {
    const double sign = side == 0 ? -1.0 : 1.0;
    const int sensor = problem.sensor_idx[images[side]];
    const Matrix3d sensor_part = -sign * *problem.world_from_cam[images[side]];
    if (!is_one_frame) {
      add(positions_->frame_center[problem.frame_idx[images[side]]].data(),
          sign * Matrix3d::Identity());
    }
    if (problem.sensor_kind[sensor] == SensorKind::kFree) {
      add(positions_->sensor_translation[sensor].data(), sensor_part);
    } else {
      baseline.constant += sensor_part * positions_->sensor_translation[sensor];
    }
  }
  return baseline;
}

void AngleProblem::AddDirections(double weight) {
  for (size_t i = 0; i < input_.motions.size(); ++i) {
    const PairMotion& motion = input_.motions[i];
    if (!IsUsable(motion, PairKind::kDirection)) continue;
    std::vector<double*> blocks;
    const LinearBaseline baseline = MakeBaseline(motion, &blocks);
    if (blocks.empty()) continue;
    const double pair_weight = weight * kDirectionSigma /
                               std::hypot(motion.sigma_rad, kDirectionSigma);
    problem_.AddResidualBlock(
        new BaselineDirectionCost(baseline, motion.direction, pair_weight,
                                  kMinRelativeLength * Length(i)),
        &loss_, blocks);
  }
}

void AngleProblem::AddLengths() {
  for (size_t i = 0; i < input_.motions.size(); ++i) {
    const PairMotion& motion = input_.motions[i];
    if (!IsUsable(motion, PairKind::kDirection)) continue;
    std::vector<double*> blocks;
    const LinearBaseline baseline = MakeBaseline(motion, &blocks);
    if (blocks.empty()) continue;
    const double weight =
        kDirectionSigma / std::hypot(input_.scales.sigma_log[i], kScaleSigma);
    problem_.AddResidualBlock(
        new BaselineLengthCost(baseline, Length(i), weight,
                               kMinRelativeLength * Length(i)),
        &loss_, blocks);
  }
}

void AngleProblem::AddZeroBaselines(double weight) {
  for (const PairMotion& motion : input_.motions) {
    if (!IsUsable(motion, PairKind::kNoParallax)) continue;
    std::vector<double*> blocks;
    const LinearBaseline baseline = MakeBaseline(motion, &blocks);
    if (blocks.empty()) continue;
    problem_.AddResidualBlock(new ZeroBaselineCost(baseline, weight), &loss_,
                              blocks);
  }
}

void AngleProblem::AddObservation(int image_idx, const Vector3d& ray,
                                  double* point) {
  const PositionProblem& problem = input_.problem;
  const int sensor = problem.sensor_idx[image_idx];
  const Matrix3d& world_from_cam = *problem.world_from_cam[image_idx];
  double* center =
      positions_->frame_center[problem.frame_idx[image_idx]].data();
  Vector3d& translation = positions_->sensor_translation[sensor];
  if (problem.sensor_kind[sensor] == SensorKind::kFree) {
    problem_.AddResidualBlock(new PointDirectionCost(ray, &world_from_cam),
                              &loss_, center, translation.data(), point);
  } else {
    const Vector3d offset = -(world_from_cam * translation);
    problem_.AddResidualBlock(new PointDirectionFixedSensorCost(ray, offset),
                              &loss_, center, point);
  }
}

void AngleProblem::AddPoints(const TrackRays& rays,
                             const std::vector<size_t>& track_idxs,
                             TrackPoints* points) {
  for (const size_t t : track_idxs) {
    double* point = points->point_in_world[t]->data();
    for (size_t k = rays.tracks.offsets[t]; k < rays.tracks.offsets[t + 1];
         ++k) {
      if (!points->observation_is_used[k]) continue;
      AddObservation(rays.tracks.observations[k].image_idx,
                     rays.rays_in_world[k], point);
    }
    point_blocks_.push_back(point);
  }
}

// Fixes the first frame, and what was found to be undetermined.
void AngleProblem::AddGauge() {
  const auto& is_placed = positions_->frame_is_placed;
  const auto first = std::find(is_placed.begin(), is_placed.end(), true);
  if (first != is_placed.end()) {
    double* center = positions_->frame_center[first - is_placed.begin()].data();
    if (problem_.HasParameterBlock(center)) {
      problem_.SetParameterBlockConstant(center);
    }
  }
  std::vector<double*> blocks;
  for (const int sensor : input_.initial.free_sensors) {
    blocks.push_back(positions_->sensor_translation[sensor].data());
  }
  const double weight = 1.0 / input_.initial.group_factor[0];
  for (Eigen::Index k = 0; k < input_.initial.unobservable.rows(); ++k) {
    problem_.AddResidualBlock(
        new LinearRowCost(input_.initial.unobservable.row(k), 0.0, weight),
        nullptr, blocks);
  }
}

// Keeps the length of the longest unknown along itself. A change of scale can
// meet this exactly, so it does not affect the shape.
void AngleProblem::AddScaleGauge() {
  if (input_.initial.is_metric) return;
  Vector3d* longest = nullptr;
  const auto compare = [&](Vector3d* x) {
    if (problem_.HasParameterBlock(x->data()) &&
        (longest == nullptr || x->squaredNorm() > longest->squaredNorm())) {
      longest = x;
    }
  };
  for (Vector3d& center : positions_->frame_center) compare(&center);
  for (Vector3d& t : positions_->sensor_translation) compare(&t);
  if (longest == nullptr || !(longest->squaredNorm() > 0.0)) return;
  problem_.AddResidualBlock(
      new LinearRowCost(*longest / longest->squaredNorm(), 1.0, 1.0), nullptr,
      longest->data());
}

SolveSummary AngleProblem::Solve(ceres::LinearSolverType solver_type,
                                 int max_iterations) {
  ceres::Solver::Options options;
  options.linear_solver_type = solver_type;
  options.max_num_iterations = max_iterations;
  options.function_tolerance = options_.function_tolerance;
  options.gradient_tolerance = 1e-16;
  options.parameter_tolerance = 1e-10;
  // Ceres adds up a Schur complement in the order in which threads arrive, so
  // with more than one the result would differ from run to run.
  options.num_threads = 1;
  options.logging_type = ceres::SILENT;
  if (!point_blocks_.empty()) {
    // Within a group Ceres goes by address. Each group is one array, so that
    // the order does not depend on where the arrays happen to lie.
    auto* ordering = new ceres::ParameterBlockOrdering;
    const auto add = [&](Vector3d& x, int group) {
      if (problem_.HasParameterBlock(x.data())) {
        ordering->AddElementToGroup(x.data(), group);
      }
    };
    for (Vector3d& x : positions_->frame_center) add(x, 1);
    for (Vector3d& x : positions_->sensor_translation) add(x, 2);
    for (double* block : point_blocks_) ordering->AddElementToGroup(block, 0);
    options.linear_solver_ordering.reset(ordering);
  }
  ceres::Solver::Summary ceres_summary;
  ceres::Solve(options, &problem_, &ceres_summary);
  SolveSummary summary;
  summary.num_iterations = static_cast<int>(ceres_summary.iterations.size());
  summary.initial_cost = ceres_summary.initial_cost;
  summary.final_cost = ceres_summary.final_cost;
  summary.message = ceres_summary.message;
  if (ceres_summary.termination_type == ceres::CONVERGENCE) {
    summary.termination = Termination::kConverged;
  } else if (ceres_summary.IsSolutionUsable()) {
    summary.termination = Termination::kMaxIterations;
  }
  return summary;
}

bool HasDirections(const RefinementInput& input) {
  return !input.scales.group_sizes.empty();
}

SolveSummary NothingToDo(const char* message) {
  SolveSummary summary;
  summary.termination = Termination::kConverged;
  summary.message = message;
  return summary;
}

}  // namespace

SolveSummary RefineCameras(const RefinementInput& input,
                           const AngleRefinementOptions& options,
                           Positions* positions) {
  if (!HasDirections(input)) return NothingToDo("No pair has parallax.");
  AngleProblem problem(input, options, positions);
  problem.AddDirections(1.0);
  problem.AddLengths();
  // Weak, only to place what nothing else does.
  problem.AddZeroBaselines(0.01 * kDirectionSigma /
                           input.initial.group_factor[0]);
  problem.AddGauge();
  constexpr int kNumCoarseIterations = 10;
  SolveSummary summary;
  for (const double factor : {8.0, 2.0, 1.0}) {
    problem.SetLossScale(factor * options.loss_scale_rad);
    summary = problem.Solve(
        ceres::SPARSE_NORMAL_CHOLESKY,
        factor > 1.0 ? kNumCoarseIterations : options.max_num_iterations);
    if (!summary.IsUsable()) break;
  }
  return summary;
}

SolveSummary RefineCamerasAndPoints(const RefinementInput& input,
                                    const TrackRays& rays,
                                    const std::vector<size_t>& track_idxs,
                                    const AngleRefinementOptions& options,
                                    Positions* positions, TrackPoints* points) {
  if (!HasDirections(input) || track_idxs.size() < kMinNumPoints) {
    return NothingToDo("Too few points.");
  }
  AngleProblem problem(input, options, positions);
  problem.AddPoints(rays, track_idxs, points);
  problem.AddDirections(kPairWeightWithPoints);
  problem.AddGauge();
  problem.AddScaleGauge();
  return problem.Solve(ceres::SPARSE_SCHUR, options.max_num_iterations);
}

}  // namespace mgsfm

// SPDX-License-Identifier: BSD-3-Clause
#include "translation/bilinear_refinement.h"

#include <ceres/ceres.h>

#include <algorithm>
#include <cstddef>
#include <utility>

#include "mgsfm/base/error.h"

namespace mgsfm {
namespace {

using Eigen::Matrix3d;
using Eigen::Vector3d;

constexpr double kMinScale = 1e-5;

// C = sum_k coefficients_k * blocks_k, of three coordinates each.
struct Difference {
  std::vector<double*> blocks;
  std::vector<Matrix3d> coefficients;

  // Ceres wants each block once.
  void Add(double* block, const Matrix3d& coefficient) {
    for (size_t k = 0; k < blocks.size(); ++k) {
      if (blocks[k] != block) continue;
      coefficients[k] += coefficient;
      return;
    }
    blocks.push_back(block);
    coefficients.push_back(coefficient);
  }

  Vector3d Value() const {
    Vector3d sum = Vector3d::Zero();
    for (size_t k = 0; k < blocks.size(); ++k) {
      sum += coefficients[k] * Eigen::Map<const Vector3d>(blocks[k]);
    }
    return sum;
  }
};

// Its last block is the scale.
class BilinearCost : public ceres::CostFunction {
 public:
  BilinearCost(std::vector<Matrix3d> coefficients, const Vector3d& direction,
               double weight)
      : coefficients_(std::move(coefficients)),
        direction_(direction),
        weight_(weight) {
    set_num_residuals(3);
    mutable_parameter_block_sizes()->assign(coefficients_.size(), 3);
    mutable_parameter_block_sizes()->push_back(1);
  }

  bool Evaluate(double const* const* blocks, double* residuals,
                double** jacobians) const override {
    const size_t num_blocks = coefficients_.size();
    Vector3d difference = Vector3d::Zero();
    for (size_t k = 0; k < num_blocks; ++k) {
      difference += coefficients_[k] * Eigen::Map<const Vector3d>(blocks[k]);
    }
    const BilinearResidual residual = EvaluateBilinear(
        direction_, difference, blocks[num_blocks][0], weight_);
    Eigen::Map<Vector3d>{residuals} = residual.value;
    if (jacobians == nullptr) return true;
    for (size_t k = 0; k < num_blocks; ++k) {
      if (jacobians[k] == nullptr) continue;
      Eigen::Map<Eigen::Matrix<double, 3, 3, Eigen::RowMajor>>{jacobians[k]} =
          residual.by_difference * coefficients_[k];
    }
    if (jacobians[num_blocks] != nullptr) {
      Eigen::Map<Vector3d>{jacobians[num_blocks]} = residual.by_scale;
    }
    return true;
  }

 private:
  const std::vector<Matrix3d> coefficients_;
  const Vector3d direction_;
  const double weight_;
};

// weight * (d * length - 1), d a scale.
class LengthCost : public ceres::SizedCostFunction<1, 1> {
 public:
  LengthCost(double length, double weight) : length_(length), weight_(weight) {}

  bool Evaluate(double const* const* blocks, double* residuals,
                double** jacobians) const override {
    residuals[0] = weight_ * (blocks[0][0] * length_ - 1.0);
    if (jacobians != nullptr && jacobians[0] != nullptr) {
      jacobians[0][0] = weight_ * length_;
    }
    return true;
  }

 private:
  const double length_;
  const double weight_;
};

// sum_k coefficients_k . x_k.
class SumCost : public ceres::CostFunction {
 public:
  explicit SumCost(std::vector<Vector3d> coefficients)
      : coefficients_(std::move(coefficients)) {
    set_num_residuals(1);
    mutable_parameter_block_sizes()->assign(coefficients_.size(), 3);
  }

  bool Evaluate(double const* const* blocks, double* residuals,
                double** jacobians) const override {
    residuals[0] = 0.0;
    for (size_t k = 0; k < coefficients_.size(); ++k) {
      residuals[0] +=
          coefficients_[k].dot(Eigen::Map<const Vector3d>(blocks[k]));
      if (jacobians != nullptr && jacobians[k] != nullptr) {
        Eigen::Map<Vector3d>{jacobians[k]} = coefficients_[k];
      }
    }
    return true;
  }

 private:
  const std::vector<Vector3d> coefficients_;
};

class StopWhenCancelled : public ceres::IterationCallback {
 public:
  explicit StopWhenCancelled(const Context& context) : context_(context) {}

  ceres::CallbackReturnType operator()(
      const ceres::IterationSummary&) override {
    return context_.is_cancelled && context_.is_cancelled()
               ? ceres::SOLVER_ABORT
               : ceres::SOLVER_CONTINUE;
  }

 private:
  const Context& context_;
};

ceres::Problem::Options WithoutLossOwnership() {
  ceres::Problem::Options options;
  options.loss_function_ownership = ceres::DO_NOT_TAKE_OWNERSHIP;
  return options;
}

// Works on copies of positions and points.
class BilinearProblem {
 public:
  BilinearProblem(const RefinementInput& input,
                  const RefinementOptions& options, const Positions& positions)
      : input_(input),
        options_(options),
        positions_(positions),
        num_frames_(positions.frame_center.size()),
        cameras_(positions.frame_center),
        loss_(nullptr, ceres::TAKE_OWNERSHIP),
        problem_(WithoutLossOwnership()) {
    cameras_.insert(cameras_.end(), positions.sensor_translation.begin(),
                    positions.sensor_translation.end());
    SetLossScale(options.loss_scale_rad);
  }

  // At most so many; they must not move when others are added.
  void ReserveScales(size_t num_scales) { scales_.reserve(num_scales); }
  void SetLossScale(double scale_rad) {
    if (options_.loss == RobustLossType::kHuber) {
      loss_.Reset(new ceres::HuberLoss(scale_rad), ceres::TAKE_OWNERSHIP);
    } else {
      loss_.Reset(new ceres::CauchyLoss(scale_rad), ceres::TAKE_OWNERSHIP);
    }
  }

  void AddDirections(double weight, bool with_lengths);
  void AddZeroBaselines();
  void AddPoints(const TrackRays& rays, const std::vector<size_t>& track_idxs,
                 const TrackPoints& points);
  void HoldGauge();
  SolveSummary Solve(int max_num_iterations, const Context& context);

  Positions Solution() const;
  const std::vector<Vector3d>& points() const { return points_; }

 private:
  void AddCenter(int image_idx, double sign, Difference* difference);
  Difference Baseline(const PairMotion& motion);
  double* FrameBlock(size_t frame) { return cameras_[frame].data(); }
  double* SensorBlock(size_t sensor) {
    return cameras_[num_frames_ + sensor].data();
  }
  // With a scale of its own.
  double* AddBilinear(const Difference& difference, const Vector3d& direction,
                      double min_length, double weight);

  const RefinementInput& input_;
  const RefinementOptions& options_;
  const Positions& positions_;
  const size_t num_frames_;
  std::vector<Vector3d> cameras_;  // frames, then sensors
  std::vector<Vector3d> points_;
  std::vector<double> scales_;
  double one_ = 1.0;
  ceres::LossFunctionWrapper loss_;
  ceres::Problem problem_;
};

// sign * c_i.
void BilinearProblem::AddCenter(int image_idx, double sign,
                                Difference* difference) {
  const PositionProblem& known = input_.problem;
  const int frame = known.frame_idx[image_idx];
  const int sensor = known.sensor_idx[image_idx];
  difference->Add(FrameBlock(frame), sign * Matrix3d::Identity());
  if (!input_.IsFree(image_idx) &&
      positions_.sensor_translation[sensor].isZero(0.0)) {
    return;
  }
  difference->Add(SensorBlock(sensor),
                  -sign * *known.world_from_cam[image_idx]);
}

Difference BilinearProblem::Baseline(const PairMotion& motion) {
  Difference baseline;
  AddCenter(motion.image_idx2, 1.0, &baseline);
  AddCenter(motion.image_idx1, -1.0, &baseline);
  return baseline;
}

Positions BilinearProblem::Solution() const {
  Positions solution = positions_;
  const auto first_sensor =
      cameras_.begin() + static_cast<std::ptrdiff_t>(num_frames_);
  solution.frame_center.assign(cameras_.begin(), first_sensor);
  solution.sensor_translation.assign(first_sensor, cameras_.end());
  return solution;
}

double* BilinearProblem::AddBilinear(const Difference& difference,
                                     const Vector3d& direction,
                                     double min_length, double weight) {
  MGSFM_CHECK_LT(scales_.size(), scales_.capacity());
  const double length = std::max(difference.Value().norm(), min_length);
  scales_.push_back(
      options_.starts_at_random ? 1.0 : std::max(1.0 / length, kMinScale));
  std::vector<double*> blocks = difference.blocks;
  blocks.push_back(&scales_.back());
  problem_.AddResidualBlock(
      new BilinearCost(difference.coefficients, direction, weight), &loss_,
      blocks);
  problem_.SetParameterLowerBound(&scales_.back(), 0, kMinScale);
  return &scales_.back();
}

void BilinearProblem::AddDirections(double weight, bool with_lengths) {
  for (size_t i = 0; i < input_.motions.size(); ++i) {
    const PairMotion& motion = input_.motions[i];
    if (!input_.IsUsable(motion, MotionKind::kDirection, positions_)) continue;
    const double length = input_.Length(i);
    double* scale = AddBilinear(Baseline(motion), motion.direction,
                                kMinRelativeLength * length,
                                input_.DirectionWeight(i, weight));
    if (!with_lengths) continue;
    problem_.AddResidualBlock(new LengthCost(length, input_.LengthWeight(i)),
                              &loss_, scale);
  }
}

void BilinearProblem::AddZeroBaselines() {
  for (const PairMotion& motion : input_.motions) {
    if (!input_.IsUsable(motion, MotionKind::kNoParallax, positions_)) continue;
    Difference baseline = Baseline(motion);
    baseline.blocks.push_back(&one_);
    problem_.AddResidualBlock(
        new BilinearCost(baseline.coefficients, Vector3d::Zero(),
                         input_.ZeroBaselineWeight()),
        &loss_, baseline.blocks);
    problem_.SetParameterBlockConstant(&one_);
  }
}

void BilinearProblem::AddPoints(const TrackRays& rays,
                                const std::vector<size_t>& track_idxs,
                                const TrackPoints& points) {
  constexpr double kMinDistance = 1e-9;
  points_.reserve(track_idxs.size());
  for (const size_t t : track_idxs) {
    points_.push_back(*points.point_in_world[t]);
    for (size_t k = rays.tracks.offsets[t]; k < rays.tracks.offsets[t + 1];
         ++k) {
      if (!points.observation_is_used[k]) continue;
      Difference from_camera;
      from_camera.Add(points_.back().data(), Matrix3d::Identity());
      AddCenter(rays.tracks.observations[k].image_idx, -1.0, &from_camera);
      AddBilinear(from_camera, rays.rays_in_world[k], kMinDistance, 1.0);
    }
  }
}

void BilinearProblem::HoldGauge() {
  bool has_constant_frame = false;
  for (size_t f = 0; f < num_frames_ && !has_constant_frame; ++f) {
    if (!problem_.HasParameterBlock(FrameBlock(f))) continue;
    problem_.SetParameterBlockConstant(FrameBlock(f));
    has_constant_frame = true;
  }
  const InitialPositions& initial = input_.initial;
  for (Eigen::Index row = 0; row < initial.unobservable.rows(); ++row) {
    std::vector<Vector3d> coefficients;
    std::vector<double*> blocks;
    for (size_t s = 0; s < initial.free_sensors.size(); ++s) {
      const auto first = 3 * static_cast<Eigen::Index>(s);
      const Vector3d part = initial.unobservable.row(row).segment<3>(first);
      coefficients.emplace_back(part / initial.group_factor[0]);
      blocks.push_back(SensorBlock(initial.free_sensors[s]));
    }
    problem_.AddResidualBlock(new SumCost(coefficients), nullptr, blocks);
  }
  for (size_t s = 0; s < positions_.sensor_translation.size(); ++s) {
    double* block = SensorBlock(s);
    if (input_.problem.sensor_kind[s] != SensorKind::kFree &&
        problem_.HasParameterBlock(block)) {
      problem_.SetParameterBlockConstant(block);
    }
  }
}

SolveSummary BilinearProblem::Solve(int max_num_iterations,
                                    const Context& context) {
  ceres::Solver::Options options;
  // Twice as fast here as SPARSE_SCHUR with scales eliminated first.
  options.linear_solver_type = ceres::SPARSE_NORMAL_CHOLESKY;
  options.max_num_iterations = max_num_iterations;
  options.function_tolerance = options_.function_tolerance;
  options.num_threads = 1;
  options.logging_type = ceres::SILENT;
  StopWhenCancelled callback(context);
  options.callbacks.push_back(&callback);
  ceres::Solver::Summary result;
  ceres::Solve(options, &problem_, &result);
  context.CheckInterrupted();
  SolveSummary summary;
  summary.num_iterations =
      std::max(0, static_cast<int>(result.iterations.size()) - 1);
  summary.initial_cost = result.initial_cost;
  summary.final_cost = result.final_cost;
  summary.message = result.message;
  if (!result.IsSolutionUsable()) return summary;
  summary.termination = result.termination_type == ceres::CONVERGENCE
                            ? Termination::kConverged
                            : Termination::kMaxIterations;
  return summary;
}

}  // namespace

SolveSummary RefineCamerasBilinearly(const RefinementInput& input,
                                     const RefinementOptions& options,
                                     const Context& context,
                                     Positions* positions) {
  if (!input.HasDirections()) return NothingToDo("No pair has parallax.");
  BilinearProblem problem(input, options, *positions);
  problem.ReserveScales(input.motions.size());
  problem.AddDirections(1.0, true);
  problem.AddZeroBaselines();
  problem.HoldGauge();
  SolveSummary summary;
  for (const double factor : kLossAnnealing) {
    problem.SetLossScale(factor * options.loss_scale_rad);
    summary = problem.Solve(
        factor > 1.0 ? kNumCoarseRefinements : options.max_num_iterations,
        context);
    if (!summary.IsUsable()) return summary;
  }
  *positions = problem.Solution();
  return summary;
}

SolveSummary RefineCamerasAndPointsBilinearly(
    const RefinementInput& input, const TrackRays& rays,
    const std::vector<size_t>& track_idxs, const RefinementOptions& options,
    const Context& context, Positions* positions, TrackPoints* points) {
  if (!IsDetermined(input, track_idxs)) return NothingToDo("Too few points.");
  BilinearProblem problem(input, options, *positions);
  problem.ReserveScales(input.motions.size() + rays.tracks.observations.size());
  problem.AddPoints(rays, track_idxs, *points);
  problem.AddDirections(kPairWeightWithPoints, false);
  problem.HoldGauge();
  SolveSummary summary = problem.Solve(options.max_num_iterations, context);
  if (!summary.IsUsable()) return summary;
  *positions = problem.Solution();
  for (size_t k = 0; k < track_idxs.size(); ++k) {
    points->point_in_world[track_idxs[k]] = problem.points()[k];
  }
  return summary;
}

}  // namespace mgsfm

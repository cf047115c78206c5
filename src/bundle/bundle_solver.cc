// SPDX-License-Identifier: BSD-3-Clause
#include "bundle/bundle_solver.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <utility>
#include <vector>

#include "bundle/bundle_structure.h"
#include "bundle/chunks.h"
#include "bundle/normal_equations.h"
#include "bundle/observation_terms.h"
#include "mgsfm/geometry/so3.h"
#include "mgsfm/math/robust_loss.h"

namespace mgsfm {
namespace {

constexpr double kInfinity = std::numeric_limits<double>::infinity();

double PointCost(const BundleProblem& problem,
                 const std::vector<ImagePose>& poses, size_t point_idx,
                 const Eigen::Vector3d& point) {
  const RobustLoss loss{RobustLossType::kHuber, problem.loss_scale_px};
  double cost = 0.0;
  for (size_t o = problem.point_begin[point_idx];
       o < problem.point_begin[point_idx + 1]; ++o) {
    const BundleProblem::PixelObservation& observation =
        problem.observations[o];
    const auto residual =
        EvaluateResidual(poses[observation.image], point, observation.pixel);
    if (!residual) return kInfinity;
    cost += 0.5 * loss.Cost(residual->squaredNorm());
  }
  return cost;
}

double PriorCost(const BundleProblem& problem, const BundleState& state) {
  double cost = 0.0;
  for (const BundleProblem::ParameterPrior& prior : problem.priors) {
    const double residual =
        (state.cameras[prior.camera][prior.param] - prior.value) / prior.sigma;
    cost += 0.5 * residual * residual;
  }
  return cost;
}

PoseVector BlockStep(const BundleStructure& structure, const BundleStep& step,
                     int block) {
  return step.blocks.segment<6>(structure.blocks[block].first);
}

// The state after a step, but for its points.
BundleState MoveBlocks(const BundleProblem& problem,
                       const BundleStructure& structure, const BundleStep& step,
                       const BundleState& state) {
  BundleState moved = state;
  for (size_t i = 0; i < state.frames.size(); ++i) {
    if (structure.frame_block[i] < 0) continue;
    const PoseVector d = BlockStep(structure, step, structure.frame_block[i]);
    FramePose& pose = moved.frames[i];
    pose.rig_from_world =
        (ExpSO3(d.head<3>()) * pose.rig_from_world).normalized();
    pose.center += d.tail<3>();
  }
  for (size_t i = 0; i < state.sensors.size(); ++i) {
    if (structure.sensor_block[i] < 0) continue;
    const PoseVector d = BlockStep(structure, step, structure.sensor_block[i]);
    Rigid3& pose = moved.sensors[i];
    pose.rotation = (ExpSO3(d.head<3>()) * pose.rotation).normalized();
    pose.translation += d.tail<3>();
  }
  for (size_t i = 0; i < state.cameras.size(); ++i) {
    if (structure.camera_block[i] < 0) continue;
    const int first = structure.blocks[structure.camera_block[i]].first;
    const std::vector<int>& params = problem.cameras[i].free_params;
    for (size_t k = 0; k < params.size(); ++k) {
      moved.cameras[i][params[k]] += step.blocks[first + k];
    }
  }
  return moved;
}

// Squared lengths of the state and of a step over all that has a block.
std::pair<double, double> SquaredLengths(const BundleStructure& structure,
                                         const BundleState& state,
                                         const BundleStep& step,
                                         int num_threads) {
  double length = 0.0;
  for (size_t i = 0; i < state.frames.size(); ++i) {
    if (structure.frame_block[i] < 0) continue;
    length += 1.0 + state.frames[i].center.squaredNorm();
  }
  for (size_t i = 0; i < state.sensors.size(); ++i) {
    if (structure.sensor_block[i] < 0) continue;
    length += 1.0 + state.sensors[i].translation.squaredNorm();
  }
  const auto sum = [&](const std::vector<Eigen::Vector3d>& vectors) {
    return ParallelSum(vectors.size(), num_threads,
                       [&](size_t i) { return vectors[i].squaredNorm(); });
  };
  return {length + sum(state.points),
          step.blocks.squaredNorm() + sum(step.points)};
}

class LevenbergMarquardt {
 public:
  LevenbergMarquardt(const BundleProblem& problem,
                     const BundleSolverOptions& options, int num_threads,
                     BundleState* state)
      : problem_(problem),
        options_(options),
        num_threads_(num_threads),
        structure_(problem),
        equations_(problem, structure_, num_threads),
        state_(*state) {}

  SolveSummary Run() {
    if (!Start()) return summary_;
    while (!is_done_ && summary_.num_iterations < options_.max_num_iterations) {
      ++summary_.num_iterations;
      if (!equations_.Solve(lambda_, &step_)) {
        Reject();
        continue;
      }
      if (StepIsSmall()) break;
      const double new_cost = TryStep();
      const double decrease = cost_ - new_cost;
      const double predicted = equations_.PredictedDecrease(lambda_, step_);
      if (decrease > kMinRatio * predicted && decrease > 0.0) {
        Accept(new_cost, decrease / predicted);
      } else if (predicted <= kRoundOff * cost_) {
        Finish(Termination::kConverged, "No step lowers the cost.");
      } else {
        Reject();
      }
    }
    summary_.final_cost = cost_;
    return summary_;
  }

  BundleState TakeState() { return std::move(state_); }

 private:
  static constexpr double kMinRatio = 1e-3;
  static constexpr double kRoundOff = 1e-14;
  static constexpr double kMinLambda = 1e-16;
  static constexpr double kMaxLambda = 1e16;

  bool Start();
  bool StepIsSmall();
  // Sets trial_ to the state after the step and returns its cost.
  double TryStep();
  double TryPoint(const std::vector<ImagePose>& poses, size_t point);
  void Accept(double new_cost, double ratio);
  void Reject();
  void Finish(Termination termination, const char* message) {
    summary_.termination = termination;
    summary_.message = message;
    is_done_ = true;
  }

  const BundleProblem& problem_;
  const BundleSolverOptions& options_;
  const int num_threads_;
  const BundleStructure structure_;
  NormalEquations equations_;
  BundleState state_;
  BundleState trial_;
  BundleStep step_;
  double cost_ = 0.0;
  double lambda_ = 1e-4;
  double lambda_growth_ = 2.0;
  bool is_done_ = false;
  SolveSummary summary_;
};

bool LevenbergMarquardt::Start() {
  cost_ = BundleCost(problem_, state_, num_threads_);
  summary_.initial_cost = summary_.final_cost = cost_;
  if (!std::isfinite(cost_) || !equations_.Linearize(state_)) {
    Finish(Termination::kFailure, "The start has no finite cost.");
    return false;
  }
  summary_.termination = Termination::kMaxIterations;
  summary_.message = "Reached the largest number of iterations.";
  if (cost_ == 0.0) Finish(Termination::kConverged, "The start is optimal.");
  return true;
}

bool LevenbergMarquardt::StepIsSmall() {
  const auto [length, step_length] =
      SquaredLengths(structure_, state_, step_, num_threads_);
  const double tolerance = options_.parameter_tolerance;
  if (std::sqrt(step_length) > tolerance * (std::sqrt(length) + tolerance)) {
    return false;
  }
  Finish(Termination::kConverged, "The step is small.");
  return true;
}

double LevenbergMarquardt::TryStep() {
  trial_ = MoveBlocks(problem_, structure_, step_, state_);
  const std::vector<ImagePose> poses = ComputeImagePoses(problem_, trial_);
  return PriorCost(problem_, trial_) +
         ParallelSum(problem_.num_points(), num_threads_,
                     [&](size_t point) { return TryPoint(poses, point); });
}

double LevenbergMarquardt::TryPoint(const std::vector<ImagePose>& poses,
                                    size_t point) {
  for (const double fraction : {1.0, 0.5, 0.25, 0.0}) {
    trial_.points[point] =
        state_.points[point] + fraction * step_.points[point];
    const double cost = PointCost(problem_, poses, point, trial_.points[point]);
    if (std::isfinite(cost)) return cost;
  }
  return kInfinity;
}

void LevenbergMarquardt::Accept(double new_cost, double ratio) {
  const bool is_converged =
      cost_ - new_cost <= options_.function_tolerance * cost_;
  std::swap(state_, trial_);
  cost_ = new_cost;
  const double t = 2.0 * ratio - 1.0;
  lambda_ =
      std::max(kMinLambda, lambda_ * std::max(1.0 / 3.0, 1.0 - t * t * t));
  lambda_growth_ = 2.0;
  if (is_converged || cost_ == 0.0) {
    Finish(Termination::kConverged, "The cost hardly changes.");
  } else if (!equations_.Linearize(state_)) {
    Finish(Termination::kFailure, "A derivative is not finite.");
  }
}

void LevenbergMarquardt::Reject() {
  lambda_ *= lambda_growth_;
  lambda_growth_ *= 2.0;
  if (lambda_ > kMaxLambda) {
    Finish(Termination::kFailure, "No damping gives a step.");
  }
}

}  // namespace

double BundleCost(const BundleProblem& problem, const BundleState& state,
                  int num_threads) {
  const std::vector<ImagePose> poses = ComputeImagePoses(problem, state);
  return PriorCost(problem, state) +
         ParallelSum(problem.num_points(), num_threads, [&](size_t point) {
           return PointCost(problem, poses, point, state.points[point]);
         });
}

SolveSummary SolveBundle(const BundleProblem& problem,
                         const BundleSolverOptions& options, int num_threads,
                         BundleState* state) {
  LevenbergMarquardt solver(problem, options, num_threads, state);
  SolveSummary summary = solver.Run();
  if (summary.IsUsable()) *state = solver.TakeState();
  return summary;
}

}  // namespace mgsfm

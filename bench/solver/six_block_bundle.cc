// SPDX-License-Identifier: BSD-3-Clause
#include "solver/six_block_bundle.h"

#include <ceres/ceres.h>

#include <vector>

#include "mgsfm/base/error.h"
#include "mgsfm/base/timer.h"

namespace mgsfm {
namespace {

struct PinholeError {
  Eigen::Vector2d pixel;

  // Quaternions are in the order x, y, z, w.
  template <class T>
  bool operator()(const T* frame_rotation, const T* frame_center,
                  const T* sensor_rotation, const T* sensor_translation,
                  const T* point, const T* camera, T* residual) const {
    using Vector = Eigen::Matrix<T, 3, 1>;
    using ConstVector = Eigen::Map<const Vector>;
    using ConstQuaternion = Eigen::Map<const Eigen::Quaternion<T>>;
    const Vector in_rig = ConstQuaternion(frame_rotation) *
                          (ConstVector(point) - ConstVector(frame_center));
    const Vector x = ConstQuaternion(sensor_rotation) * in_rig +
                     ConstVector(sensor_translation);
    if (!(x[2] > T(0.0))) return false;
    residual[0] = camera[0] * x[0] / x[2] + camera[2] - pixel[0];
    residual[1] = camera[1] * x[1] / x[2] + camera[3] - pixel[1];
    return true;
  }
};

using PinholeCost =
    ceres::AutoDiffCostFunction<PinholeError, 2, 4, 3, 4, 3, 3, 4>;

void SetFreedom(const PoseMask& mask, double* rotation, double* translation,
                ceres::Problem* problem) {
  problem->SetManifold(rotation, new ceres::EigenQuaternionManifold);
  if (mask.head<3>().isZero(0.0)) problem->SetParameterBlockConstant(rotation);
  std::vector<int> held;
  for (int i = 0; i < 3; ++i) {
    if (mask[3 + i] == 0.0) held.push_back(i);
  }
  if (held.size() == 3) {
    problem->SetParameterBlockConstant(translation);
  } else if (!held.empty()) {
    problem->SetManifold(translation, new ceres::SubsetManifold(3, held));
  }
}

void CheckCameras(const RigProblemBase& problem) {
  for (const RigProblemBase::Camera& camera : problem.cameras) {
    if (camera.model != CameraModelId::kPinhole ||
        !camera.free_params.empty()) {
      throw Error(
          "the yardstick knows only PINHOLE cameras with intrinsics held; hold "
          "them with --Mapper.BundleAdjustment.refine_focal_length no");
    }
  }
}

void AddObservations(const RigProblem<PixelObservation>& problem,
                     ceres::LossFunction* loss, RigState* state,
                     ceres::Problem* ceres_problem) {
  for (size_t p = 0; p < problem.num_points(); ++p) {
    for (size_t o = problem.point_begin[p]; o < problem.point_begin[p + 1];
         ++o) {
      const PixelObservation& observation = problem.observations[o];
      const RigProblemBase::Image& image = problem.images[observation.image];
      FramePose& frame = state->frames[image.frame];
      Rigid3& sensor = state->sensors[image.sensor];
      ceres_problem->AddResidualBlock(
          new PinholeCost(new PinholeError{observation.pixel.cast<double>()}),
          loss, frame.rig_from_world.coeffs().data(), frame.center.data(),
          sensor.rotation.coeffs().data(), sensor.translation.data(),
          state->points[p].data(), state->cameras[image.camera].data());
    }
  }
}

ceres::Solver::Options SolverOptions(int max_num_iterations,
                                     double function_tolerance,
                                     int num_threads) {
  ceres::Solver::Options options;
  options.linear_solver_type = ceres::SPARSE_SCHUR;
  options.max_num_iterations = max_num_iterations;
  options.function_tolerance = function_tolerance;
  options.parameter_tolerance = 1e-10;
  options.gradient_tolerance = 1e-16;
  options.num_threads = num_threads;
  options.logging_type = ceres::SILENT;
  return options;
}

}  // namespace

SolveSummary SolveSixBlockBundle(const RigProblem<PixelObservation>& problem,
                                 int max_num_iterations,
                                 double function_tolerance, int num_threads,
                                 RigState* state, double* seconds) {
  CheckCameras(problem);
  ceres::HuberLoss loss(problem.loss.scale);
  ceres::Problem::Options ownership;
  ownership.loss_function_ownership = ceres::DO_NOT_TAKE_OWNERSHIP;
  ceres::Problem ceres_problem(ownership);
  AddObservations(problem, &loss, state, &ceres_problem);
  for (size_t i = 0; i < state->frames.size(); ++i) {
    FramePose& frame = state->frames[i];
    SetFreedom(problem.frame_masks[i], frame.rig_from_world.coeffs().data(),
               frame.center.data(), &ceres_problem);
  }
  for (size_t i = 0; i < state->sensors.size(); ++i) {
    Rigid3& sensor = state->sensors[i];
    SetFreedom(problem.sensor_masks[i], sensor.rotation.coeffs().data(),
               sensor.translation.data(), &ceres_problem);
  }
  for (CameraParams& camera : state->cameras) {
    ceres_problem.SetParameterBlockConstant(camera.data());
  }
  const Timer timer;
  ceres::Solver::Summary result;
  ceres::Solve(
      SolverOptions(max_num_iterations, function_tolerance, num_threads),
      &ceres_problem, &result);
  *seconds = timer.Seconds();
  SolveSummary summary;
  if (result.IsSolutionUsable()) {
    summary.termination = result.termination_type == ceres::CONVERGENCE
                              ? Termination::kConverged
                              : Termination::kMaxIterations;
  }
  // The first entry is the start.
  summary.num_iterations = static_cast<int>(result.iterations.size()) - 1;
  summary.initial_cost = result.initial_cost;
  summary.final_cost = result.final_cost;
  summary.message = result.message;
  return summary;
}

}  // namespace mgsfm

// SPDX-License-Identifier: BSD-3-Clause
#include "estimation/bundle_adjustment/ceres_reference.h"

#include <ceres/ceres.h>

#include <cmath>
#include <vector>

namespace mgsfm {
namespace {

struct ReferenceError {
  CameraModelId model;
  const double* params;
  Eigen::Vector2d pixel;

  // Quaternions are (x, y, z, w).
  bool operator()(const double* frame_rotation, const double* frame_center,
                  const double* sensor_rotation,
                  const double* sensor_translation, const double* point,
                  double* residual) const {
    using Vector = Eigen::Map<const Eigen::Vector3d>;
    using Quaternion = Eigen::Map<const Eigen::Quaterniond>;
    const Eigen::Vector3d in_rig =
        Quaternion(frame_rotation) * (Vector(point) - Vector(frame_center));
    const auto projected = ProjectToPixel(
        model, params,
        Quaternion(sensor_rotation) * in_rig + Vector(sensor_translation));
    if (!projected) return false;
    Eigen::Map<Eigen::Vector2d>{residual} = *projected - pixel;
    return true;
  }
};

using ReprojectionCost =
    ceres::NumericDiffCostFunction<ReferenceError, ceres::CENTRAL, 2, 4, 3, 4,
                                   3, 3>;

void SetFreedom(const PoseMask& mask, double* rotation, double* translation,
                ceres::Problem* problem) {
  problem->SetManifold(rotation, new ceres::EigenQuaternionManifold);
  if (mask[0] == 0.0) problem->SetParameterBlockConstant(rotation);
  std::vector<int> fixed;
  for (int i = 0; i < 3; ++i) {
    if (mask[3 + i] == 0.0) fixed.push_back(i);
  }
  if (fixed.size() == 3) {
    problem->SetParameterBlockConstant(translation);
  } else if (!fixed.empty()) {
    problem->SetManifold(translation, new ceres::SubsetManifold(3, fixed));
  }
}

}  // namespace

double SolveWithCeres(const BundleProblem& problem, BundleState* state) {
  ceres::Problem ceres_problem;
  for (size_t p = 0; p < problem.num_points(); ++p) {
    // A point absorbs three of the coordinates of its observations.
    const auto num_observations = static_cast<double>(
        problem.point_begin[p + 1] - problem.point_begin[p]);
    const double scale =
        problem.loss.scale * std::sqrt(1.0 - 1.5 / num_observations);
    for (size_t o = problem.point_begin[p]; o < problem.point_begin[p + 1];
         ++o) {
      const auto& observation = problem.observations[o];
      const auto& image = problem.images[observation.image];
      FramePose& frame = state->frames[image.frame];
      Rigid3& sensor = state->sensors[image.sensor];
      ceres_problem.AddResidualBlock(
          new ReprojectionCost(
              new ReferenceError{problem.cameras[image.camera].model,
                                 state->cameras[image.camera].data(),
                                 observation.pixel.cast<double>()}),
          new ceres::CauchyLoss(scale), frame.rig_from_world.coeffs().data(),
          frame.center.data(), sensor.rotation.coeffs().data(),
          sensor.translation.data(), state->points[p].data());
    }
  }
  for (size_t i = 0; i < state->frames.size(); ++i) {
    SetFreedom(problem.frame_masks[i],
               state->frames[i].rig_from_world.coeffs().data(),
               state->frames[i].center.data(), &ceres_problem);
  }
  for (size_t i = 0; i < state->sensors.size(); ++i) {
    SetFreedom(problem.sensor_masks[i],
               state->sensors[i].rotation.coeffs().data(),
               state->sensors[i].translation.data(), &ceres_problem);
  }
  ceres::Solver::Options options;
  options.linear_solver_type = ceres::SPARSE_SCHUR;
  options.max_num_iterations = 200;
  options.function_tolerance = 1e-14;
  options.parameter_tolerance = 1e-14;
  options.gradient_tolerance = 1e-14;
  options.logging_type = ceres::SILENT;
  ceres::Solver::Summary summary;
  ceres::Solve(options, &ceres_problem, &summary);
  return summary.final_cost;
}

}  // namespace mgsfm

// SPDX-License-Identifier: BSD-3-Clause
#include "translation/pose_graph.h"

#include <ceres/ceres.h>

#include <Eigen/Core>
#include <algorithm>
#include <cmath>

#include "geometry/so3.h"
#include "least_squares/ceres_manifolds.h"
#include "least_squares/ceres_solving.h"
#include "mgsfm/base/error.h"

namespace mgsfm {
namespace {

using Eigen::Matrix3d;
using Eigen::Quaterniond;
using Eigen::Vector3d;

// docs/results/constants.md shows the sensitivity to these constants.
constexpr double kRotationSigma = DegToRad(0.2);
constexpr double kMinSigmaInDepths = 1e-3;
constexpr double kLossScale = 3.0;
constexpr int kMaxNumIterations = 50;
constexpr double kFunctionTolerance = 1e-6;

// The residual of a pair, by the rotations (x, y, z, w) and centres of its two
// frames.
struct PairError {
  Quaterniond sensor_rotation1, sensor_rotation2;  // cam_from_rig
  Vector3d sensor_translation1, sensor_translation2;
  Quaterniond cam2_from_cam1;
  Vector3d baseline_in_cam1;
  Matrix3d sqrt_information;  // of the baseline

  template <class T>
  bool operator()(const T* rotation1, const T* center1, const T* rotation2,
                  const T* center2, T* residual) const {
    using Rotation = Eigen::Quaternion<T>;
    using Vector = Eigen::Matrix<T, 3, 1>;
    const Rotation cam1_from_world =
        sensor_rotation1.cast<T>() * Eigen::Map<const Rotation>(rotation1);
    const Rotation cam2_from_world =
        sensor_rotation2.cast<T>() * Eigen::Map<const Rotation>(rotation2);
    const Vector baseline_in_world =
        Eigen::Map<const Vector>(center2) -
        cam2_from_world.conjugate() * sensor_translation2.cast<T>() -
        Eigen::Map<const Vector>(center1) +
        cam1_from_world.conjugate() * sensor_translation1.cast<T>();
    const Rotation error = cam2_from_cam1.cast<T>().conjugate() *
                           (cam2_from_world * cam1_from_world.conjugate());
    const T factor((error.w() < T(0) ? -2.0 : 2.0) / kRotationSigma);
    Eigen::Map<Eigen::Matrix<T, 6, 1>> errors(residual);
    errors.template head<3>() = factor * error.vec();
    errors.template tail<3>() =
        sqrt_information.cast<T>() *
        (cam1_from_world * baseline_in_world - baseline_in_cam1.cast<T>());
    return true;
  }
};

PairError ErrorOf(const RefinementInput& input, size_t pair_idx,
                  const ImagePair& pair, const RotationEstimate& rotations) {
  const BaselineDirection& baseline = input.baselines[pair_idx];
  const PositionProblem& problem = input.problem;
  const int sensor1 = problem.sensor_idx[baseline.image_idx1];
  const int sensor2 = problem.sensor_idx[baseline.image_idx2];
  const auto& translations = input.initial.positions.sensor_translation;
  const double length = input.Length(pair_idx);
  const double min_sigma = kMinSigmaInDepths * input.scales.typical_depth *
                           input.initial.group_factor[0];
  const double along =
      1.0 / std::hypot(length * input.LengthSigma(pair_idx), min_sigma);
  const double across =
      1.0 / std::hypot(length * input.DirectionSigma(pair_idx), min_sigma);
  const Vector3d direction =
      problem.world_from_cam[baseline.image_idx1]->transpose() *
      baseline.direction;
  return {*rotations.sensor_from_rig[sensor1],
          *rotations.sensor_from_rig[sensor2],
          translations[sensor1],
          translations[sensor2],
          pair.relative_pose->cam2_from_cam1,
          length * direction,
          across * Matrix3d::Identity() +
              (along - across) * direction * direction.transpose()};
}

// The poses of all frames, as blocks of Ceres.
struct FramePoses {
  std::vector<Quaterniond> rig_from_world;
  std::vector<Vector3d> center;
};

FramePoses StartOf(const RefinementInput& input,
                   const RotationEstimate& rotations) {
  FramePoses poses{{}, input.initial.positions.frame_center};
  for (const auto& rotation : rotations.rig_from_world) {
    poses.rig_from_world.push_back(rotation.value_or(Quaterniond::Identity()));
  }
  return poses;
}

// Which pairs between frames constrain the poses.
std::vector<size_t> SelectPairs(const RefinementInput& input) {
  std::vector<size_t> selected;
  for (size_t i = 0; i < input.baselines.size(); ++i) {
    const BaselineDirection& baseline = input.baselines[i];
    if (input.IsUsable(i, BaselineKind::kDirection, input.initial.positions) &&
        input.problem.frame_idx[baseline.image_idx1] !=
            input.problem.frame_idx[baseline.image_idx2]) {
      selected.push_back(i);
    }
  }
  return selected;
}

void HoldFirstFrame(FramePoses* poses, ceres::Problem* problem) {
  for (size_t f = 0; f < poses->center.size(); ++f) {
    double* center = poses->center[f].data();
    if (!problem->HasParameterBlock(center)) continue;
    problem->SetParameterBlockConstant(center);
    problem->SetParameterBlockConstant(
        poses->rig_from_world[f].coeffs().data());
    return;
  }
}

SolveSummary Solve(const RefinementInput& input, const ViewGraph& view_graph,
                   const RotationEstimate& rotations,
                   const std::vector<size_t>& pair_idxs, double loss_scale,
                   const Context& context, FramePoses* poses) {
  // The problem owns what is added to it; sharing is allowed.
  ceres::Problem problem;
  auto* loss = new ceres::CauchyLoss(loss_scale);
  auto* manifold = new CeresQuaternionManifold();
  for (const size_t i : pair_idxs) {
    const BaselineDirection& baseline = input.baselines[i];
    const int f1 = input.problem.frame_idx[baseline.image_idx1];
    const int f2 = input.problem.frame_idx[baseline.image_idx2];
    double* rotation1 = poses->rig_from_world[f1].coeffs().data();
    double* rotation2 = poses->rig_from_world[f2].coeffs().data();
    auto* error =
        new PairError(ErrorOf(input, i, view_graph.pairs[i], rotations));
    problem.AddResidualBlock(
        new ceres::AutoDiffCostFunction<PairError, 6, 4, 3, 4, 3>(error), loss,
        rotation1, poses->center[f1].data(), rotation2,
        poses->center[f2].data());
    SetManifold(rotation1, manifold, &problem);
    SetManifold(rotation2, manifold, &problem);
  }
  HoldFirstFrame(poses, &problem);
  ceres::Solver::Options options;
  options.linear_solver_type = ceres::SPARSE_NORMAL_CHOLESKY;
  options.max_num_iterations = kMaxNumIterations;
  options.function_tolerance = kFunctionTolerance;
  options.logging_type = ceres::SILENT;
  StopWhenCancelled stop(context);
  options.callbacks.push_back(&stop);
  ceres::Solver::Summary summary;
  ceres::Solve(options, &problem, &summary);
  context.CheckInterrupted();
  return SummarizeCeres(summary);
}

}  // namespace

PoseGraphEstimate RefinePoseGraph(const RefinementInput& input,
                                  const ViewGraph& view_graph,
                                  const RotationEstimate& rotations,
                                  const Context& context) {
  MGSFM_CHECK_EQ(view_graph.pairs.size(), input.baselines.size());
  PoseGraphEstimate estimate{rotations.rig_from_world, {}};
  const std::vector<size_t> pair_idxs = SelectPairs(input);
  if (pair_idxs.empty()) {
    estimate.summary = NothingToDo("No pair of frames has a direction.");
    return estimate;
  }
  FramePoses poses = StartOf(input, rotations);
  for (const double factor : kLossAnnealing) {
    estimate.summary = Solve(input, view_graph, rotations, pair_idxs,
                             factor * kLossScale, context, &poses);
    if (!estimate.summary.IsUsable()) return estimate;
  }
  for (size_t f = 0; f < poses.rig_from_world.size(); ++f) {
    if (estimate.rig_from_world[f]) {
      estimate.rig_from_world[f] = poses.rig_from_world[f].normalized();
    }
  }
  return estimate;
}

}  // namespace mgsfm

// SPDX-License-Identifier: BSD-3-Clause
#include "translation_averaging/pose_graph.h"

#include <ceres/ceres.h>

#include <Eigen/Core>
#include <algorithm>
#include <cmath>
#include <iterator>

#include "geometry/so3.h"
#include "math/robust_scale.h"
#include "mgsfm/base/error.h"
#include "rig_solver/ceres_solving.h"

namespace mgsfm {
namespace {

using Eigen::Matrix3d;
using Eigen::Quaterniond;
using Eigen::Vector3d;

// Relative rotations from 30 matches have errors of some tenths of a degree.
// With half the value, a displaced step can remain (docs/results/constants.md).
constexpr double kPoseRotationSigma = DegToRad(0.2);
// The error that remains however many keypoints vote: 0.06 degrees, about the
// error of averaged rotations (kRotationSigma in baseline_directions.cc).
constexpr double kMinSigmaInDepths = 1e-3;
// A pair shows no parallax if its baseline is shorter than about this: three
// times the sine of the smallest parallax of 0.3 degrees.
constexpr double kStandingSigmaInDepths = 0.016;

// The residual of a pair as a function of the rotations (x, y, z, w) and
// centers of its two frames.
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
    const T factor((error.w() < T(0) ? -2.0 : 2.0) / kPoseRotationSigma);
    Eigen::Map<Eigen::Matrix<T, 6, 1>> errors(residual);
    errors.template head<3>() = factor * error.vec();
    errors.template tail<3>() =
        sqrt_information.cast<T>() *
        (cam1_from_world * baseline_in_world - baseline_in_cam1.cast<T>());
    return true;
  }
};

// The baseline of a pair in camera 1, and the square root of its information.
struct BaselineInformation {
  Vector3d baseline_in_cam1 = Vector3d::Zero();
  Matrix3d sqrt_information;
};

BaselineInformation MeasuredBaselineOf(const RefinementInput& input,
                                       size_t pair_idx) {
  const BaselineDirection& baseline = input.baselines[pair_idx];
  const auto& scale = input.scales.pairs[pair_idx];
  const int group = scale ? scale->group : 0;
  const double depth =
      input.scales.typical_depth * input.initial.group_factor[group];
  if (baseline.kind == BaselineKind::kNoParallax) {
    return {Vector3d::Zero(),
            Matrix3d::Identity() / (kStandingSigmaInDepths * depth)};
  }
  const double length = input.Length(pair_idx);
  const double min_sigma = kMinSigmaInDepths * depth;
  // The factors of other groups are unknown.
  const double along =
      group != 0
          ? 0.0
          : 1.0 / std::hypot(length * input.LengthSigma(pair_idx), min_sigma);
  const double across =
      1.0 / std::hypot(length * input.DirectionSigma(pair_idx), min_sigma);
  const Vector3d direction =
      input.problem.world_from_cam[baseline.image_idx1]->transpose() *
      baseline.direction;
  return {length * direction,
          across * Matrix3d::Identity() +
              (along - across) * direction * direction.transpose()};
}

PairError ErrorOf(const RefinementInput& input, size_t pair_idx,
                  const ImagePair& pair, const RotationEstimate& rotations) {
  const BaselineDirection& baseline = input.baselines[pair_idx];
  const int sensor1 = input.problem.sensor_idx[baseline.image_idx1];
  const int sensor2 = input.problem.sensor_idx[baseline.image_idx2];
  const auto& translations = input.initial.positions.sensor_translation;
  const BaselineInformation measured = MeasuredBaselineOf(input, pair_idx);
  return {*rotations.sensor_from_rig[sensor1],
          *rotations.sensor_from_rig[sensor2],
          translations[sensor1],
          translations[sensor2],
          pair.relative_pose->cam2_from_cam1,
          measured.baseline_in_cam1,
          measured.sqrt_information};
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

// The used pairs between placed frames.
std::vector<size_t> SelectPairs(const RefinementInput& input,
                                const ViewGraph& view_graph) {
  std::vector<size_t> selected;
  for (size_t i = 0; i < input.baselines.size(); ++i) {
    const BaselineDirection& baseline = input.baselines[i];
    const BaselineKind kind = baseline.kind;
    if (kind != BaselineKind::kUnused && view_graph.pairs[i].relative_pose &&
        input.IsUsable(i, kind, input.initial.positions) &&
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

// The edges of the graph, and the measurements of all pairs.
struct PoseEdges {
  const RefinementInput& input;
  const ViewGraph& view_graph;
  const RotationEstimate& rotations;
  const std::vector<size_t> pair_idxs;
};

SolveSummary Solve(const PoseEdges& edges, double loss_scale,
                   const Context& context, FramePoses* poses) {
  const RefinementInput& input = edges.input;
  // The problem owns the objects added to it; a loss may be shared.
  ceres::Problem problem;
  auto* loss = new ceres::CauchyLoss(loss_scale);
  auto* manifold = new CeresQuaternionManifold();
  for (const size_t i : edges.pair_idxs) {
    const BaselineDirection& baseline = input.baselines[i];
    const int f1 = input.problem.frame_idx[baseline.image_idx1];
    const int f2 = input.problem.frame_idx[baseline.image_idx2];
    double* rotation1 = poses->rig_from_world[f1].coeffs().data();
    double* rotation2 = poses->rig_from_world[f2].coeffs().data();
    auto* error = new PairError(
        ErrorOf(input, i, edges.view_graph.pairs[i], edges.rotations));
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
  // The result must not depend on the kernels of a BLAS or on threads.
  options.sparse_linear_algebra_library_type = ceres::EIGEN_SPARSE;
  options.num_threads = 1;
  options.logging_type = ceres::SILENT;
  StopWhenCanceled stop(context);
  options.callbacks.push_back(&stop);
  ceres::Solver::Summary summary;
  ceres::Solve(options, &problem, &summary);
  context.CheckInterrupted();
  return SummarizeCeres(summary);
}

Mask SolvedFrames(const RefinementInput& input,
                  const std::vector<size_t>& pair_idxs) {
  Mask is_solved(input.initial.positions.frame_center.size(), false);
  for (const size_t i : pair_idxs) {
    for (const int image :
         {input.baselines[i].image_idx1, input.baselines[i].image_idx2}) {
      is_solved[input.problem.frame_idx[image]] = true;
    }
  }
  return is_solved;
}

// Replaces the rotations of solved frames. Other frames rotate in the world
// like the previous solved frame, or like the first one.
void TurnFrames(const Mask& is_solved, const std::vector<Quaterniond>& solved,
                std::vector<std::optional<Quaterniond>>* rig_from_world) {
  const auto first = static_cast<size_t>(std::distance(
      is_solved.begin(), std::find(is_solved.begin(), is_solved.end(), true)));
  Quaterniond turn = (*rig_from_world)[first]->inverse() * solved[first];
  for (size_t f = 0; f < solved.size(); ++f) {
    auto& rotation = (*rig_from_world)[f];
    if (!rotation) continue;
    if (is_solved[f]) turn = rotation->inverse() * solved[f];
    rotation = (*rotation * turn).normalized();
  }
}

}  // namespace

PoseGraphEstimate RefinePoseGraph(const RefinementInput& input,
                                  const ViewGraph& view_graph,
                                  const RotationEstimate& rotations,
                                  const Context& context) {
  MGSFM_CHECK_EQ(view_graph.pairs.size(), input.baselines.size());
  PoseGraphEstimate estimate{rotations.rig_from_world, {}};
  const PoseEdges edges{input, view_graph, rotations,
                        SelectPairs(input, view_graph)};
  if (edges.pair_idxs.empty()) {
    estimate.summary = NothingToDo("No pair connects two placed frames.");
    return estimate;
  }
  FramePoses poses = StartOf(input, rotations);
  for (const double factor : kLossAnnealing) {
    estimate.summary =
        Solve(edges, factor * kCauchyScaleInSigmas, context, &poses);
    if (!estimate.summary.IsUsable()) return estimate;
  }
  TurnFrames(SolvedFrames(input, edges.pair_idxs), poses.rig_from_world,
             &estimate.rig_from_world);
  return estimate;
}

}  // namespace mgsfm

// SPDX-License-Identifier: BSD-3-Clause
#include "rig_solver/pose_covariances.h"

#include <algorithm>

#include "rig_solver/residuals.h"
#include "rig_solver/rig_equations.h"

namespace mgsfm {
namespace {

using Equations = RigEquations<PixelResidual>;

// Poses per solve; bounds the memory of the right-hand sides.
constexpr size_t kBlocksPerSolve = 16;

// A pose with free coordinates.
struct FreePose {
  int block = 0;
  const PoseMask* mask = nullptr;
  std::optional<PoseMatrix>* covariance = nullptr;
};

// Lists free poses. Constant poses get a zero covariance.
void ListPoses(const std::vector<int>& blocks,
               const std::vector<PoseMask>& masks,
               std::vector<std::optional<PoseMatrix>>* covariances,
               std::vector<FreePose>* poses) {
  covariances->resize(blocks.size());
  for (size_t i = 0; i < blocks.size(); ++i) {
    if (blocks[i] != kNoBlock) {
      poses->push_back({blocks[i], &masks[i], &(*covariances)[i]});
    } else if (masks[i].isZero(0.0)) {
      (*covariances)[i] = PoseMatrix::Zero();
    }
  }
}

// Solves for the poses [begin, end).
void SolveForPoses(const RigEquationsBase& equations,
                   const std::vector<FreePose>& poses, size_t begin,
                   size_t end) {
  const RigStructure& s = equations.structure();
  const int size = s.pose_size;
  Eigen::MatrixXd columns = Eigen::MatrixXd::Zero(
      s.num_unknowns, static_cast<Eigen::Index>(end - begin) * size);
  for (size_t k = begin; k < end; ++k) {
    const auto first = static_cast<Eigen::Index>(k - begin) * size;
    columns.block(s.block_first[poses[k].block], first, size, size)
        .setIdentity();
  }
  equations.SolveColumns(columns, &columns);
  for (size_t k = begin; k < end; ++k) {
    const auto first = static_cast<Eigen::Index>(k - begin) * size;
    PoseMatrix covariance = PoseMatrix::Zero();
    covariance.bottomRightCorner(size, size) =
        columns.block(s.block_first[poses[k].block], first, size, size);
    covariance = 0.5 * (covariance + covariance.transpose()).eval();
    *poses[k].covariance =
        poses[k].mask->asDiagonal() * covariance * poses[k].mask->asDiagonal();
  }
}

// All sensors or all frames of a problem.
struct PoseList {
  const std::vector<int>& blocks;
  const std::vector<PoseMask>& masks;
};

Eigen::MatrixXd CovarianceOfGroup(const RigEquationsBase& equations,
                                  const PoseList& poses,
                                  const std::vector<int>& group) {
  const RigStructure& s = equations.structure();
  const Eigen::Index size = s.pose_size;
  const auto count = static_cast<Eigen::Index>(group.size());
  Eigen::MatrixXd columns = Eigen::MatrixXd::Zero(s.num_unknowns, count * size);
  const auto first_of = [&](Eigen::Index k) -> std::optional<Eigen::Index> {
    const int block = poses.blocks[group[k]];
    if (block == kNoBlock) return std::nullopt;
    return Eigen::Index{s.block_first[block]};
  };
  for (Eigen::Index k = 0; k < count; ++k) {
    const auto first = first_of(k);
    if (first) columns.block(*first, k * size, size, size).setIdentity();
  }
  equations.SolveColumns(columns, &columns);
  Eigen::MatrixXd covariance = Eigen::MatrixXd::Zero(6 * count, 6 * count);
  for (Eigen::Index a = 0; a < count; ++a) {
    for (Eigen::Index b = 0; b < count; ++b) {
      if (!first_of(a) || !first_of(b)) continue;
      PoseMatrix block = PoseMatrix::Zero();
      block.bottomRightCorner(size, size) =
          columns.block(*first_of(a), b * size, size, size);
      covariance.block<6, 6>(6 * a, 6 * b) =
          poses.masks[group[a]].asDiagonal() * block *
          poses.masks[group[b]].asDiagonal();
    }
  }
  return 0.5 * (covariance + covariance.transpose());
}

std::optional<std::vector<Eigen::MatrixXd>> ComputeOfGroups(
    const RigProblem<PixelObservation>& problem, const RigState& state,
    const std::vector<std::vector<int>>& groups, const Context& context,
    bool are_sensors) {
  Equations equations(problem, {ReducedSolver::kDirect}, context);
  equations.SetState(state);
  if (!equations.Linearize(kCovarianceDamping) || !equations.Factorize()) {
    return std::nullopt;
  }
  const RigStructure& s = equations.structure();
  const PoseList poses = are_sensors
                             ? PoseList{s.sensor_block, problem.sensor_masks}
                             : PoseList{s.frame_block, problem.frame_masks};
  std::vector<Eigen::MatrixXd> covariances;
  covariances.reserve(groups.size());
  for (const std::vector<int>& group : groups) {
    context.CheckInterrupted();
    covariances.push_back(CovarianceOfGroup(equations, poses, group));
  }
  return covariances;
}

// Diagonal elements of the inverse for the unknowns [first, first + count).
std::vector<double> SolveForVariances(const RigEquationsBase& equations,
                                      int first, int count) {
  Eigen::MatrixXd columns =
      Eigen::MatrixXd::Zero(equations.structure().num_unknowns, count);
  columns.middleRows(first, count).setIdentity();
  equations.SolveColumns(columns, &columns);
  std::vector<double> variances;
  for (int i = 0; i < count; ++i) variances.push_back(columns(first + i, i));
  return variances;
}

}  // namespace

std::optional<PoseCovariances> ComputePoseCovariances(
    const RigProblem<PixelObservation>& problem, const RigState& state,
    const Context& context) {
  Equations equations(problem, {ReducedSolver::kDirect}, context);
  const RigStructure& s = equations.structure();
  PoseCovariances result;
  std::vector<FreePose> poses;
  ListPoses(s.frame_block, problem.frame_masks, &result.frames, &poses);
  ListPoses(s.sensor_block, problem.sensor_masks, &result.sensors, &poses);
  if (poses.empty()) return result;
  equations.SetState(state);
  if (!equations.Linearize(kCovarianceDamping) || !equations.Factorize()) {
    return std::nullopt;
  }
  for (size_t begin = 0; begin < poses.size(); begin += kBlocksPerSolve) {
    context.CheckInterrupted();
    SolveForPoses(equations, poses, begin,
                  std::min(begin + kBlocksPerSolve, poses.size()));
  }
  return result;
}

std::optional<std::vector<Eigen::MatrixXd>> ComputeSensorCovariances(
    const RigProblem<PixelObservation>& problem, const RigState& state,
    const std::vector<std::vector<int>>& groups, const Context& context) {
  return ComputeOfGroups(problem, state, groups, context, true);
}

std::optional<std::vector<Eigen::MatrixXd>> ComputeFrameCovariances(
    const RigProblem<PixelObservation>& problem, const RigState& state,
    const std::vector<std::vector<int>>& groups, const Context& context) {
  return ComputeOfGroups(problem, state, groups, context, false);
}

std::optional<std::vector<std::vector<double>>> ComputeParameterVariances(
    const RigProblem<PixelObservation>& problem, const RigState& state,
    const Context& context) {
  Equations equations(problem, {ReducedSolver::kDirect}, context);
  const RigStructure& s = equations.structure();
  std::vector<std::vector<double>> variances(problem.cameras.size());
  equations.SetState(state);
  if (!equations.Linearize(kCovarianceDamping) || !equations.Factorize()) {
    return std::nullopt;
  }
  for (size_t i = 0; i < problem.cameras.size(); ++i) {
    const int block = s.camera_block[i];
    if (block == kNoBlock) continue;
    variances[i] = SolveForVariances(
        equations, s.block_first[block],
        static_cast<int>(problem.cameras[i].free_params.size()));
  }
  return variances;
}

}  // namespace mgsfm

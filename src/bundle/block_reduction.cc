// SPDX-License-Identifier: BSD-3-Clause
#include "bundle/block_reduction.h"

#include <algorithm>
#include <utility>

#include "least_squares/damping.h"
#include "math/sparse_solver.h"

namespace mgsfm {
namespace {

using Triplets = std::vector<Eigen::Triplet<double>>;

void AddTriplets(const Triplets& triplets, Eigen::SparseMatrix<double>* sum) {
  Eigen::SparseMatrix<double> part(sum->rows(), sum->cols());
  part.setFromTriplets(triplets.begin(), triplets.end());
  *sum = Eigen::SparseMatrix<double>(*sum + part);
}

}  // namespace

ModelUnknowns NumberUnknowns(const Scene& scene, const Reconstruction& model) {
  ModelUnknowns unknowns;
  const auto take = [&](size_t count) {
    const int first = unknowns.num_unknowns;
    unknowns.num_unknowns += static_cast<int>(count);
    return first;
  };
  for (const auto& pose : model.rig_from_world) {
    unknowns.first_of_frame.push_back(pose ? take(6) : -1);
  }
  for (size_t i = 0; i < scene.sensors.size(); ++i) {
    unknowns.first_of_sensor.push_back(take(6));
  }
  for (const Camera& camera : scene.cameras) {
    unknowns.first_of_camera.push_back(take(camera.params.size()));
  }
  return unknowns;
}

std::vector<int> FindUnknowns(const BuiltProblem& built,
                              const ModelUnknowns& unknowns,
                              const RigStructure& s) {
  std::vector<int> found(s.num_unknowns, -1);
  const auto find_pose = [&](int block, int first) {
    if (block == kNoBlock) return;
    for (int k = 0; k < s.pose_size; ++k) {
      found[s.block_first[block] + k] = first + 6 - s.pose_size + k;
    }
  };
  for (size_t i = 0; i < built.frame_idxs.size(); ++i) {
    find_pose(s.frame_block[i], unknowns.first_of_frame[built.frame_idxs[i]]);
  }
  for (size_t i = 0; i < built.sensor_idxs.size(); ++i) {
    find_pose(s.sensor_block[i],
              unknowns.first_of_sensor[built.sensor_idxs[i]]);
  }
  for (size_t i = 0; i < built.camera_idxs.size(); ++i) {
    if (s.camera_block[i] == kNoBlock) continue;
    const std::vector<int>& params = built.problem.cameras[i].free_params;
    for (size_t k = 0; k < params.size(); ++k) {
      found[s.block_first[s.camera_block[i]] + k] =
          unknowns.first_of_camera[built.camera_idxs[i]] + params[k];
    }
  }
  return found;
}

ReducedBlock ReduceBlock(std::vector<int> unknowns,
                         const RigEquationsBase& equations) {
  ReducedBlock reduced{std::move(unknowns), equations.matrix(),
                       equations.RightHandSide(), equations.diagonal()};
  for (double& value : reduced.damping) {
    if (value > 0.0) value = ClampDiagonal(value);
  }
  return reduced;
}

SummedSystem::SummedSystem(const std::vector<ReducedBlock>& blocks,
                           const Mask& is_held) {
  const auto size = static_cast<int>(is_held.size());
  rhs_ = damping_ = Eigen::VectorXd::Zero(size);
  matrix_.resize(size, size);
  for (const ReducedBlock& block : blocks) {
    Triplets triplets;
    triplets.reserve(static_cast<size_t>(block.matrix.nonZeros()));
    for (int k = 0; k < block.matrix.cols(); ++k) {
      const int column = block.unknowns[k];
      if (is_held[column]) continue;
      // Of a held coordinate of the block, the row has nothing but a diagonal.
      if (block.damping[k] == 0.0) continue;
      rhs_[column] += block.rhs[k];
      damping_[column] += block.damping[k];
      for (Eigen::SparseMatrix<double>::InnerIterator it(block.matrix, k); it;
           ++it) {
        const int row = block.unknowns[it.row()];
        if (it.row() < k || is_held[row]) continue;
        triplets.emplace_back(std::max(row, column), std::min(row, column),
                              it.value());
      }
    }
    AddTriplets(triplets, &matrix_);
  }
  Triplets unmoved;
  for (int i = 0; i < size; ++i) {
    if (damping_[i] == 0.0) unmoved.emplace_back(i, i, 1.0);
  }
  AddTriplets(unmoved, &matrix_);
}

bool SummedSystem::Solve(double lambda, double reduced_lambda, int num_threads,
                         Eigen::VectorXd* step) const {
  Eigen::SparseMatrix<double> matrix = matrix_;
  for (Eigen::Index i = 0; i < damping_.size(); ++i) {
    matrix.coeffRef(i, i) += (lambda - reduced_lambda) * damping_[i];
  }
  SparseCholesky solver(num_threads);
  solver.Analyze(matrix);
  if (!solver.Factorize(matrix)) return false;
  step->resize(rhs_.size());
  solver.Solve(rhs_, *step);
  return step->allFinite();
}

}  // namespace mgsfm

// SPDX-License-Identifier: BSD-3-Clause
#include "bundle/block_reduction.h"

#include <algorithm>
#include <utility>

#include "base/fingerprint.h"
#include "least_squares/damping.h"

namespace mgsfm {
namespace {

std::string FingerprintOf(const Eigen::SparseMatrix<double>& matrix) {
  Fingerprint fingerprint;
  for (Eigen::Index i = 0; i <= matrix.outerSize(); ++i) {
    fingerprint.Add(matrix.outerIndexPtr()[i]);
  }
  for (Eigen::Index i = 0; i < matrix.nonZeros(); ++i) {
    fingerprint.Add(matrix.innerIndexPtr()[i]);
  }
  return fingerprint.ToString();
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

void SummedSystem::Start(int num_unknowns, double lambda) {
  if (matrix_.rows() != num_unknowns)
    matrix_.resize(num_unknowns, num_unknowns);
  std::fill_n(matrix_.valuePtr(), matrix_.nonZeros(), 0.0);
  rhs_.setZero(num_unknowns);
  damping_.setZero(num_unknowns);
  lambda_ = lambda;
}

// Entries that the pattern lacks are collected.
void SummedSystem::AddEntry(int row, int column, double value,
                            Triplets* missing) {
  const int* begin = matrix_.innerIndexPtr() + matrix_.outerIndexPtr()[column];
  const int* end =
      matrix_.innerIndexPtr() + matrix_.outerIndexPtr()[column + 1];
  const int* found = std::lower_bound(begin, end, row);
  if (found == end || *found != row) {
    missing->emplace_back(row, column, value);
  } else {
    matrix_.valuePtr()[found - matrix_.innerIndexPtr()] += value;
  }
}

void SummedSystem::AddMissing(const Triplets& missing) {
  if (missing.empty()) return;
  Eigen::SparseMatrix<double> part(matrix_.rows(), matrix_.cols());
  part.setFromTriplets(missing.begin(), missing.end());
  matrix_ = Eigen::SparseMatrix<double>(matrix_ + part);
}

void SummedSystem::Add(const std::vector<int>& unknowns,
                       const RigEquationsBase& equations, const Mask& is_held) {
  const Eigen::SparseMatrix<double>& block = equations.matrix();
  const Eigen::VectorXd block_rhs = equations.RightHandSide();
  Triplets missing;
  for (int k = 0; k < block.cols(); ++k) {
    const int column = unknowns[k];
    const double diagonal = equations.diagonal()[k];
    // A coordinate that the block holds has nothing but a one on the diagonal.
    if (is_held[column] || diagonal == 0.0) continue;
    rhs_[column] += block_rhs[k];
    damping_[column] += ClampDiagonal(diagonal);
    for (Eigen::SparseMatrix<double>::InnerIterator it(block, k); it; ++it) {
      const int row = unknowns[it.row()];
      if (it.row() < k || is_held[row]) continue;
      AddEntry(std::max(row, column), std::min(row, column), it.value(),
               &missing);
    }
  }
  AddMissing(missing);
}

void SummedSystem::Finish() {
  Triplets missing;
  for (int i = 0; i < static_cast<int>(damping_.size()); ++i) {
    if (damping_[i] == 0.0) AddEntry(i, i, 1.0, &missing);
  }
  AddMissing(missing);
}

void SummedSystem::Damp(double lambda) {
  for (Eigen::Index i = 0; i < damping_.size(); ++i) {
    matrix_.coeffRef(i, i) += (lambda - lambda_) * damping_[i];
  }
  lambda_ = lambda;
}

bool SummedSystemSolver::Solve(const SummedSystem& system,
                               Eigen::VectorXd* step) {
  std::string pattern = FingerprintOf(system.matrix());
  if (pattern_ != pattern) solver_.Analyze(system.matrix());
  pattern_ = std::move(pattern);
  if (!solver_.Factorize(system.matrix())) return false;
  step->resize(system.rhs().size());
  solver_.Solve(system.rhs(), *step);
  return step->allFinite();
}

}  // namespace mgsfm

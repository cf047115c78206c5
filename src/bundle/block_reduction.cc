// SPDX-License-Identifier: BSD-3-Clause
#include "bundle/block_reduction.h"

#include <algorithm>
#include <numeric>
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

SharedUnknowns NumberUnknowns(const Scene& scene, const Mask& frame_is_shared) {
  SharedUnknowns unknowns;
  const auto take = [&](size_t count) {
    const int first = unknowns.num_unknowns;
    unknowns.num_unknowns += static_cast<int>(count);
    return first;
  };
  for (size_t i = 0; i < scene.frames.size(); ++i) {
    unknowns.first_of_frame.emplace_back();
    if (frame_is_shared[i]) unknowns.first_of_frame.back() = take(6);
  }
  for (size_t i = 0; i < scene.sensors.size(); ++i) {
    unknowns.first_of_sensor.push_back(take(6));
  }
  for (const Camera& camera : scene.cameras) {
    unknowns.first_of_camera.push_back(take(camera.params.size()));
  }
  return unknowns;
}

BlockUnknowns SplitUnknowns(const BuiltProblem& built,
                            const SharedUnknowns& unknowns, const Mask& is_held,
                            const RigEquationsBase& equations) {
  const RigStructure& s = equations.structure();
  std::vector<std::optional<int>> shared(static_cast<size_t>(s.num_unknowns));
  const auto find_pose = [&](int block, std::optional<int> first) {
    if (block == kNoBlock || !first) return;
    for (int k = 0; k < s.pose_size; ++k) {
      shared[s.block_first[block] + k] = *first + 6 - s.pose_size + k;
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
      shared[s.block_first[s.camera_block[i]] + k] =
          unknowns.first_of_camera[built.camera_idxs[i]] + params[k];
    }
  }
  BlockUnknowns split;
  for (int k = 0; k < s.num_unknowns; ++k) {
    // Constant coordinates have nothing but a one on the diagonal.
    if (equations.diagonal()[k] == 0.0) continue;
    if (!shared[k]) {
      split.interior.push_back(k);
    } else if (!is_held[*shared[k]]) {
      split.shared.push_back(k);
      split.in_model.push_back(*shared[k]);
    }
  }
  return split;
}

void SummedSystem::Start(int num_unknowns, double lambda) {
  if (matrix_.rows() != num_unknowns)
    matrix_.resize(num_unknowns, num_unknowns);
  std::fill_n(matrix_.valuePtr(), matrix_.nonZeros(), 0.0);
  rhs_.setZero(num_unknowns);
  damping_.setZero(num_unknowns);
  lambda_ = lambda;
}

void SummedSystem::Add(const std::vector<int>& unknowns,
                       const Eigen::MatrixXd& matrix,
                       const Eigen::VectorXd& rhs,
                       const Eigen::VectorXd& diagonal) {
  const auto size = static_cast<Eigen::Index>(unknowns.size());
  std::vector<Eigen::Index> order(unknowns.size());
  std::iota(order.begin(), order.end(), Eigen::Index{0});
  std::sort(order.begin(), order.end(), [&](Eigen::Index a, Eigen::Index b) {
    return unknowns[a] < unknowns[b];
  });
  Eigen::SparseMatrix<double> part(matrix_.rows(), matrix_.cols());
  part.reserve(size * (size + 1) / 2);
  int column = 0;
  for (size_t c = 0; c < order.size(); ++c) {
    const Eigen::Index k = order[c];
    for (; column <= unknowns[k]; ++column) part.startVec(column);
    for (size_t r = c; r < order.size(); ++r) {
      const Eigen::Index i = order[r];
      part.insertBack(unknowns[i], unknowns[k]) =
          matrix(std::max(i, k), std::min(i, k));
    }
    rhs_[unknowns[k]] += rhs[k];
    damping_[unknowns[k]] += ClampDiagonal(diagonal[k]);
  }
  part.finalize();
  matrix_ = Eigen::SparseMatrix<double>(matrix_ + part);
}

void SummedSystem::Finish() {
  Eigen::SparseMatrix<double> ones(matrix_.rows(), matrix_.cols());
  ones.reserve(Eigen::VectorXi::Ones(matrix_.cols()));
  for (int i = 0; i < static_cast<int>(damping_.size()); ++i) {
    if (damping_[i] == 0.0) ones.insert(i, i) = 1.0;
  }
  matrix_ = Eigen::SparseMatrix<double>(matrix_ + ones);
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

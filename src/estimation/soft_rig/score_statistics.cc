// SPDX-License-Identifier: BSD-3-Clause
#include "soft_rig/score_statistics.h"

#include <Eigen/Cholesky>
#include <cmath>
#include <utility>

namespace mgsfm {
using Eigen::MatrixXd;
using Eigen::VectorXd;

MatrixXd InvertInformation(MatrixXd information) {
  MatrixXd M = std::move(information);
  VectorXd scale = M.diagonal();
  for (double& s : scale) s = s > 0.0 ? 1.0 / std::sqrt(s) : 1.0;
  M = (scale.asDiagonal() * M * scale.asDiagonal()).eval();
  // Relative to the diagonal of an information matrix.
  M.diagonal().array() += 1e-9;
  return scale.asDiagonal() *
         M.ldlt().solve(MatrixXd::Identity(M.rows(), M.cols())) *
         scale.asDiagonal();
}

VectorXd NewtonStep(const RigScores& scores) {
  return -InvertInformation(scores.information) *
         (scores.scores.rowwise().sum() + scores.scores_of_priors) /
         scores.efficiency;
}

MatrixXd Jackknife(const RigScores& scores) {
  const auto num_blocks = scores.scores.cols();
  MatrixXd covariance =
      MatrixXd::Zero(scores.scores.rows(), scores.scores.rows());
  for (Eigen::Index b = 0; b < num_blocks; ++b) {
    const VectorXd change =
        InvertInformation(scores.information - scores.block_information[b]) *
        scores.scores.col(b) / scores.efficiency;
    covariance += change * change.transpose();
  }
  return covariance * (num_blocks - 1.0) / num_blocks;
}

MatrixXd CovarianceBy(const MatrixXd& noise, const RigScores& scores) {
  const MatrixXd inverse =
      InvertInformation(scores.information) / scores.efficiency;
  return inverse * noise * inverse;
}

// The approximation of Wallace (1959).
bool IsCertain(double t, Eigen::Index num_blocks) {
  const double degrees = static_cast<double>(num_blocks) - 1.0;
  const double z = (8.0 * degrees + 1.0) / (8.0 * degrees + 3.0) *
                   std::sqrt(degrees * std::log1p(t * t / degrees));
  return z > 3.891;
}

}  // namespace mgsfm

// SPDX-License-Identifier: BSD-3-Clause
#include "rotation_averaging/hand_eye.h"

#include <algorithm>
#include <cmath>

#include "base/ranges.h"
#include "geometry/decompositions.h"
#include "geometry/so3.h"
#include "math/robust_loss.h"
#include "math/robust_scale.h"
#include "math/statistics.h"
#include "mgsfm/base/error.h"
#include "rotation_averaging/rotation_solver.h"

namespace mgsfm {
namespace {

using Eigen::Matrix3d;
using Eigen::Quaterniond;
using Eigen::Vector3d;

// argmin_X sum w |alpha - X beta|^2.
Quaterniond SolveWahba(const std::vector<MotionPair>& motions,
                       const std::vector<double>& weights) {
  Matrix3d M = Matrix3d::Zero();
  for (size_t i = 0; i < motions.size(); ++i) {
    M += weights[i] * motions[i].alpha * motions[i].beta.transpose();
  }
  const Svd3 svd(M);
  const double sign = svd.U.determinant() * svd.V.determinant() < 0 ? -1 : 1;
  const Matrix3d X =
      svd.U * Vector3d(1.0, 1.0, sign).asDiagonal() * svd.V.transpose();
  return Quaterniond(X).normalized();
}

std::vector<double> ErrorNorms(const std::vector<MotionPair>& motions,
                               const Quaterniond& a_from_b) {
  return Transformed(motions, [&](const MotionPair& motion) {
    return (motion.alpha - a_from_b * motion.beta).norm();
  });
}

double SecondAxisRms(const std::vector<MotionPair>& motions,
                     const std::vector<double>& weights) {
  Matrix3d covariance = Matrix3d::Zero();
  double sum = 0.0;
  for (size_t i = 0; i < motions.size(); ++i) {
    covariance += weights[i] * motions[i].beta * motions[i].beta.transpose();
    sum += weights[i];
  }
  const SymmetricEigen<Matrix3d> eigen(covariance / sum);
  return std::sqrt(std::max(0.0, eigen.values[1]));
}

}  // namespace

HandEyeResult CalibrateHandEye(const std::vector<MotionPair>& motions,
                               int num_independent) {
  MGSFM_CHECK(!motions.empty());
  HandEyeResult result;
  SolveSummary& summary = result.summary;
  summary.termination = Termination::kMaxIterations;
  std::vector<double> weights(motions.size(), 1.0);
  result.a_from_b = SolveWahba(motions, weights);
  std::vector<double> norms = ErrorNorms(motions, result.a_from_b);
  RobustScaleSchedule schedule;
  // Annealing takes at most 14 iterations: log(5 deg / 0.05 deg) / log(1 /
  // 0.7).
  while (summary.num_iterations < 100) {
    ++summary.num_iterations;
    const RobustLoss loss = schedule.Next(norms);
    for (size_t i = 0; i < motions.size(); ++i) {
      weights[i] = loss.Weight(norms[i] * norms[i]);
    }
    const Quaterniond last = result.a_from_b;
    result.a_from_b = SolveWahba(motions, weights);
    norms = ErrorNorms(motions, result.a_from_b);
    if (schedule.IsFinal() && AngleBetween(last, result.a_from_b) <= 1e-9) {
      summary.termination = Termination::kConverged;
      break;
    }
  }
  result.second_axis_rms_rad = SecondAxisRms(motions, weights);
  const double sigma = RobustSigma<3>(norms);
  result.median_error_rad = Median(std::move(norms));
  result.uncertainty_rad =
      sigma / std::max(1e-12, result.second_axis_rms_rad *
                                  std::sqrt(std::max(1, num_independent)));
  return result;
}

}  // namespace mgsfm

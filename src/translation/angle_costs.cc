// SPDX-License-Identifier: BSD-3-Clause
#include "translation/angle_costs.h"

#include <cmath>

namespace mgsfm {
namespace {

using Eigen::Matrix3d;
using Eigen::Vector3d;
using RowMajor3d = Eigen::Matrix<double, 3, 3, Eigen::RowMajor>;

Vector3d Baseline(const LinearBaseline& baseline,
                  double const* const* parameters) {
  Vector3d C = baseline.constant;
  for (int b = 0; b < baseline.num_blocks; ++b) {
    C += baseline.coefficients[b] * Eigen::Map<const Vector3d>(parameters[b]);
  }
  return C;
}

// Chain rule: jacobians[b] = derivative * coefficients[b].
void WriteJacobians(const LinearBaseline& baseline, const Matrix3d& derivative,
                    double** jacobians) {
  if (jacobians == nullptr) return;
  for (int b = 0; b < baseline.num_blocks; ++b) {
    if (jacobians[b] == nullptr) continue;
    RowMajor3d::Map(jacobians[b]).noalias() =
        derivative * baseline.coefficients[b];
  }
}

// Writes one Jacobian, if it is asked for.
void WriteJacobian(const Matrix3d& jacobian, double* values) {
  if (values != nullptr) RowMajor3d::Map(values) = jacobian;
}

// d(v / |v|) / dv. False where it is not defined.
bool Normalize(const Vector3d& v, Vector3d* unit, Matrix3d* derivative) {
  const double norm = v.norm();
  if (!(norm > 1e-150)) return false;
  *unit = v / norm;
  *derivative = (Matrix3d::Identity() - *unit * unit->transpose()) / norm;
  return true;
}

}  // namespace

BaselineDirectionCost::BaselineDirectionCost(const LinearBaseline& baseline,
                                             const Vector3d& direction,
                                             double weight, double min_length)
    : baseline_(baseline),
      direction_(direction),
      weight_(weight),
      min_length_(min_length) {
  set_num_residuals(3);
  mutable_parameter_block_sizes()->assign(baseline.num_blocks, 3);
}

bool BaselineDirectionCost::Evaluate(double const* const* parameters,
                                     double* residuals,
                                     double** jacobians) const {
  const Vector3d C = Baseline(baseline_, parameters);
  const double length = std::sqrt(C.squaredNorm() + min_length_ * min_length_);
  const Vector3d unit = C / length;
  Eigen::Map<Vector3d> residual(residuals);
  residual = weight_ * (direction_ - unit);
  const Matrix3d derivative =
      -weight_ / length * (Matrix3d::Identity() - unit * unit.transpose());
  WriteJacobians(baseline_, derivative, jacobians);
  return true;
}

BaselineLengthCost::BaselineLengthCost(const LinearBaseline& baseline,
                                       double length, double weight,
                                       double min_length)
    : baseline_(baseline),
      length_(length),
      weight_(weight),
      min_length_(min_length) {
  set_num_residuals(1);
  mutable_parameter_block_sizes()->assign(baseline.num_blocks, 3);
}

bool BaselineLengthCost::Evaluate(double const* const* parameters,
                                  double* residuals, double** jacobians) const {
  const Vector3d C = Baseline(baseline_, parameters);
  const double length2 = C.squaredNorm() + min_length_ * min_length_;
  residuals[0] = weight_ * (0.5 * std::log(length2) - std::log(length_));
  const Eigen::RowVector3d derivative = weight_ / length2 * C.transpose();
  if (jacobians == nullptr) return true;
  for (int b = 0; b < baseline_.num_blocks; ++b) {
    if (jacobians[b] == nullptr) continue;
    Eigen::RowVector3d::Map(jacobians[b]) =
        derivative * baseline_.coefficients[b];
  }
  return true;
}

ZeroBaselineCost::ZeroBaselineCost(const LinearBaseline& baseline,
                                   double weight)
    : baseline_(baseline), weight_(weight) {
  set_num_residuals(3);
  mutable_parameter_block_sizes()->assign(baseline.num_blocks, 3);
}

bool ZeroBaselineCost::Evaluate(double const* const* parameters,
                                double* residuals, double** jacobians) const {
  Eigen::Map<Vector3d> residual(residuals);
  residual = weight_ * Baseline(baseline_, parameters);
  const Matrix3d derivative = weight_ * Matrix3d::Identity();
  WriteJacobians(baseline_, derivative, jacobians);
  return true;
}

LinearRowCost::LinearRowCost(const Eigen::VectorXd& row, double value,
                             double weight)
    : row_(row), value_(value), weight_(weight) {
  set_num_residuals(1);
  mutable_parameter_block_sizes()->assign(row.size() / 3, 3);
}

bool LinearRowCost::Evaluate(double const* const* parameters, double* residuals,
                             double** jacobians) const {
  residuals[0] = -weight_ * value_;
  for (Eigen::Index b = 0; 3 * b < row_.size(); ++b) {
    const Vector3d part = weight_ * row_.segment<3>(3 * b);
    residuals[0] += part.dot(Eigen::Map<const Vector3d>(parameters[b]));
    if (jacobians != nullptr && jacobians[b] != nullptr) {
      Vector3d::Map(jacobians[b]) = part;
    }
  }
  return true;
}

bool PointDirectionCost::Evaluate(double const* const* parameters,
                                  double* residuals, double** jacobians) const {
  const Eigen::Map<const Vector3d> center(parameters[0]);
  const Eigen::Map<const Vector3d> translation(parameters[1]);
  const Eigen::Map<const Vector3d> point(parameters[2]);
  Vector3d unit;
  Matrix3d derivative;
  if (!Normalize(point - center + *world_from_cam_ * translation, &unit,
                 &derivative)) {
    return false;
  }
  Eigen::Map<Vector3d> residual(residuals);
  residual = ray_ - unit;
  if (jacobians == nullptr) return true;
  WriteJacobian(derivative, jacobians[0]);
  WriteJacobian(-derivative * *world_from_cam_, jacobians[1]);
  WriteJacobian(-derivative, jacobians[2]);
  return true;
}

bool PointDirectionFixedSensorCost::Evaluate(double const* const* parameters,
                                             double* residuals,
                                             double** jacobians) const {
  const Eigen::Map<const Vector3d> center(parameters[0]);
  const Eigen::Map<const Vector3d> point(parameters[1]);
  Vector3d unit;
  Matrix3d derivative;
  if (!Normalize(point - center - offset_, &unit, &derivative)) return false;
  Eigen::Map<Vector3d> residual(residuals);
  residual = ray_ - unit;
  if (jacobians == nullptr) return true;
  WriteJacobian(derivative, jacobians[0]);
  WriteJacobian(-derivative, jacobians[1]);
  return true;
}

}  // namespace mgsfm

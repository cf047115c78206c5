// SPDX-License-Identifier: BSD-3-Clause
#include "geometry/so3.h"

#include <cmath>

namespace mgsfm {
namespace {

// Below this angle the series are more accurate than the closed forms.
constexpr double kSmallAngle = 1e-4;

}  // namespace

Eigen::Matrix3d CrossMatrix(const Eigen::Vector3d& v) {
  Eigen::Matrix3d m;
  m << 0.0, -v.z(), v.y(), v.z(), 0.0, -v.x(), -v.y(), v.x(), 0.0;
  return m;
}

Eigen::Quaterniond ExpSO3(const Eigen::Vector3d& omega) {
  const double angle = omega.norm();
  const double half = 0.5 * angle;
  const double sinc =
      angle < kSmallAngle ? 0.5 - angle * angle / 48.0 : std::sin(half) / angle;
  Eigen::Quaterniond q;
  q.w() = std::cos(half);
  q.vec() = sinc * omega;
  return q;
}

Eigen::Vector3d LogSO3(const Eigen::Quaterniond& q) {
  const double sign = q.w() < 0.0 ? -1.0 : 1.0;
  const double w = sign * q.w();
  const double n = q.vec().norm();
  const double factor = n < kSmallAngle
                            ? 2.0 / w - 2.0 * n * n / (3.0 * w * w * w)
                            : 2.0 * std::atan2(n, w) / n;
  return sign * factor * q.vec();
}

Eigen::Matrix3d InverseRightJacobianSO3(const Eigen::Vector3d& omega) {
  const double angle = omega.norm();
  const double c =
      angle < kSmallAngle
          ? 1.0 / 12.0 + angle * angle / 720.0
          : 1.0 / (angle * angle) - 1.0 / (2.0 * angle * std::tan(0.5 * angle));
  const Eigen::Matrix3d w = CrossMatrix(omega);
  return Eigen::Matrix3d::Identity() + 0.5 * w + c * w * w;
}

Eigen::Quaterniond ToUnitQuaternion(const Eigen::Quaterniond& q) {
  // Rounding of a normalized quaternion changes its squared norm by a few
  // 1e-16.
  return std::abs(q.squaredNorm() - 1.0) <= 1e-14 ? q : q.normalized();
}

Eigen::Quaterniond RotationBetween(const Eigen::Vector3d& from,
                                   const Eigen::Vector3d& to) {
  const Eigen::Vector3d a = from.normalized(), b = to.normalized();
  const double c = b.dot(a);
  Eigen::Quaterniond q;
  if (c < -1.0 + kSmallAngle * kSmallAngle) {
    // Rounding spoils c for nearly opposite directions. Half a turn about any
    // normal of a leaves a small rotation.
    q.w() = 0.0;
    q.vec() = a.unitOrthogonal();
    return RotationBetween(-a, b) * q;
  }
  const double twice_w = std::sqrt(2.0 * (1.0 + c));
  q.w() = 0.5 * twice_w;
  q.vec() = a.cross(b) * (1.0 / twice_w);
  return q;
}

double AngleBetween(const Eigen::Quaterniond& a, const Eigen::Quaterniond& b) {
  return LogSO3(a.conjugate() * b).norm();
}

double AngleBetween(const Eigen::Vector3d& a, const Eigen::Vector3d& b) {
  return std::atan2(a.cross(b).norm(), a.dot(b));
}

}  // namespace mgsfm

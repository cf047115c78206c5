// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <Eigen/Core>
#include <Eigen/Geometry>

#include "mgsfm/geometry/rigid3.h"

namespace mgsfm {

// Rotations are unit quaternions. Tangent vectors are angle-axis vectors in
// radians.

// The cross product matrix, [v]_x w = v x w.
Eigen::Matrix3d CrossMatrix(const Eigen::Vector3d& v);

// Exponential map: the rotation by |omega| radians about omega.
Eigen::Quaterniond ExpSO3(const Eigen::Vector3d& omega);

// Logarithm with norm in [0, pi]: ExpSO3(LogSO3(q)) is the same rotation as q.
Eigen::Vector3d LogSO3(const Eigen::Quaterniond& q);

// The inverse of the right Jacobian Jr, which is defined by
// Exp(omega + d) = Exp(omega) Exp(Jr(omega) d) + O(|d|^2); singular at
// |omega| = 2 pi.
Eigen::Matrix3d InverseRightJacobianSO3(const Eigen::Vector3d& omega);

// Normalizes q, which must not be zero. Quaternions of unit length up to
// rounding are returned unchanged, so that rotations survive file I/O bit by
// bit.
Eigen::Quaterniond ToUnitQuaternion(const Eigen::Quaterniond& q);

// Geodesic distance in [0, pi], radians.
double AngleBetween(const Eigen::Quaterniond& a, const Eigen::Quaterniond& b);

// The smallest rotation that turns `from` to the direction of `to`.
Eigen::Quaterniond RotationBetween(const Eigen::Vector3d& from,
                                   const Eigen::Vector3d& to);

// Angle between two vectors in [0, pi], radians; accurate for small angles.
double AngleBetween(const Eigen::Vector3d& a, const Eigen::Vector3d& b);

constexpr double kPi = EIGEN_PI;
constexpr double DegToRad(double deg) { return deg * (kPi / 180.0); }
constexpr double RadToDeg(double rad) { return rad * (180.0 / kPi); }

// The pose after the update R <- Exp(delta[0:3]) R, t <- t + delta[3:6].
inline Rigid3 Updated(const Rigid3& pose, const PoseVector& delta) {
  return {(ExpSO3(delta.head<3>()) * pose.rotation).normalized(),
          pose.translation + delta.tail<3>()};
}

// The update that leads from one pose to another.
inline PoseVector UpdateBetween(const Rigid3& from, const Rigid3& to) {
  PoseVector delta;
  delta << LogSO3(to.rotation * from.rotation.conjugate()),
      to.translation - from.translation;
  return delta;
}

}  // namespace mgsfm

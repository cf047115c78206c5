// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <Eigen/Core>

#include "mgsfm/geometry/rigid3.h"

namespace mgsfm {

// A motion, with the covariances of its rotation vector, in the later rig
// frame, and of its center, in the earlier one.
struct MeasuredMotion {
  Rigid3 later_from_earlier;
  Eigen::Matrix3d rotation_covariance = Eigen::Matrix3d::Zero();
  Eigen::Matrix3d center_covariance = Eigen::Matrix3d::Zero();

  [[nodiscard]] MeasuredMotion Inverse() const;
};

// One motion after another, with independent errors.
[[nodiscard]] MeasuredMotion Compose(const MeasuredMotion& second,
                                     const MeasuredMotion& first);

// The motion of a pose (R, t) of the later frame, or of the earlier one if it
// is reversed, with the covariance of (w, dt): Exp(w) R, t + dt.
[[nodiscard]] MeasuredMotion MeasuredMotionOf(const Rigid3& pose,
                                              const PoseMatrix& covariance,
                                              bool is_reversed);

// Per step, or per unit of time, with covariances.
struct Velocity {
  Eigen::Vector3d linear = Eigen::Vector3d::Zero();  // of the rig's origin
  Eigen::Vector3d angular_rad = Eigen::Vector3d::Zero();
  Eigen::Matrix3d linear_covariance = Eigen::Matrix3d::Zero();
  Eigen::Matrix3d angular_covariance = Eigen::Matrix3d::Zero();
};
[[nodiscard]] Velocity VelocityOf(const MeasuredMotion& motion,
                                  double duration);
[[nodiscard]] MeasuredMotion MotionOf(const Velocity& velocity,
                                      double duration);

// The variance and the standard deviation along a vector.
[[nodiscard]] double VarianceAlong(const Eigen::Matrix3d& covariance,
                                   const Eigen::Vector3d& vector);
[[nodiscard]] double SigmaAlong(const Eigen::Matrix3d& covariance,
                                const Eigen::Vector3d& vector);

}  // namespace mgsfm

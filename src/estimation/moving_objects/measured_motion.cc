// SPDX-License-Identifier: BSD-3-Clause
#include "moving_objects/measured_motion.h"

#include <algorithm>
#include <cmath>

#include "geometry/so3.h"

namespace mgsfm {

using Eigen::Matrix3d;
using Eigen::Vector3d;

MeasuredMotion MeasuredMotionOf(const Rigid3& pose,
                                const PoseMatrix& covariance,
                                bool is_reversed) {
  const Matrix3d inverse = pose.rotation.conjugate().toRotationMatrix();
  const Matrix3d of_rotation = covariance.topLeftCorner<3, 3>();
  if (is_reversed) {
    return {pose.Inverse(), inverse * of_rotation * inverse.transpose(),
            covariance.bottomRightCorner<3, 3>()};
  }
  // The center -R^T t changes by R^T (w x t - dt).
  Eigen::Matrix<double, 3, 6> by_pose;
  by_pose << CrossMatrix(pose.translation), Matrix3d::Identity();
  by_pose = -inverse * by_pose;
  return {pose, of_rotation, by_pose * covariance * by_pose.transpose()};
}

MeasuredMotion Compose(const MeasuredMotion& second,
                       const MeasuredMotion& first) {
  const Matrix3d rotation1 =
      first.later_from_earlier.rotation.toRotationMatrix();
  const Matrix3d rotation2 =
      second.later_from_earlier.rotation.toRotationMatrix();
  const Matrix3d lever = CrossMatrix(second.later_from_earlier.Center());
  return {second.later_from_earlier * first.later_from_earlier,
          second.rotation_covariance +
              rotation2 * first.rotation_covariance * rotation2.transpose(),
          first.center_covariance +
              rotation1.transpose() *
                  (second.center_covariance +
                   lever * first.rotation_covariance * lever.transpose()) *
                  rotation1};
}

MeasuredMotion MeasuredMotion::Inverse() const {
  const Matrix3d rotation = later_from_earlier.rotation.toRotationMatrix();
  return {later_from_earlier.Inverse(),
          rotation.transpose() * rotation_covariance * rotation,
          rotation * center_covariance * rotation.transpose()};
}

Velocity VelocityOf(const MeasuredMotion& motion, double duration) {
  const double squared_duration = duration * duration;
  return {motion.later_from_earlier.Center() / duration,
          LogSO3(motion.later_from_earlier.rotation) / duration,
          motion.center_covariance / squared_duration,
          motion.rotation_covariance / squared_duration};
}

MeasuredMotion MotionOf(const Velocity& velocity, double duration) {
  const double squared_duration = duration * duration;
  return {Rigid3::FromRotationAndCenter(ExpSO3(duration * velocity.angular_rad),
                                        duration * velocity.linear),
          squared_duration * velocity.angular_covariance,
          squared_duration * velocity.linear_covariance};
}

double VarianceAlong(const Matrix3d& covariance, const Vector3d& vector) {
  const double squared_length = vector.squaredNorm();
  return squared_length > 0.0 ? vector.dot(covariance * vector) / squared_length
                              : 0.0;
}

double SigmaAlong(const Matrix3d& covariance, const Vector3d& vector) {
  return std::sqrt(std::max(0.0, VarianceAlong(covariance, vector)));
}

}  // namespace mgsfm

// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <Eigen/Core>
#include <Eigen/Geometry>

namespace mgsfm {

// A matrix and a vector over the six coordinates of a pose update: three for
// the rotation (rad), then three for the translation.
using PoseMatrix = Eigen::Matrix<double, 6, 6>;
using PoseVector = Eigen::Matrix<double, 6, 1>;

// A rigid transform b_from_a: x_in_b = rotation * x_in_a + translation.
// Names compose by canceling: c_from_a = c_from_b * b_from_a.
struct Rigid3 {
  Eigen::Quaterniond rotation = Eigen::Quaterniond::Identity();
  Eigen::Vector3d translation = Eigen::Vector3d::Zero();

  // `center_in_a` is the origin of b in frame a.
  static Rigid3 FromRotationAndCenter(const Eigen::Quaterniond& b_from_a,
                                      const Eigen::Vector3d& center_in_a) {
    return {b_from_a, -(b_from_a * center_in_a)};
  }
  // The origin of b in frame a.
  Eigen::Vector3d Center() const {
    return -(rotation.conjugate() * translation);
  }
  Rigid3 Inverse() const {
    const Eigen::Quaterniond inverse = rotation.conjugate();
    return {inverse, -(inverse * translation)};
  }
  // Equal in every bit; there is no tolerance.
  friend bool operator==(const Rigid3& a, const Rigid3& b) {
    return a.rotation.coeffs() == b.rotation.coeffs() &&
           a.translation == b.translation;
  }
};

inline Eigen::Vector3d operator*(const Rigid3& b_from_a,
                                 const Eigen::Vector3d& x_in_a) {
  return b_from_a.rotation * x_in_a + b_from_a.translation;
}

inline Rigid3 operator*(const Rigid3& c_from_b, const Rigid3& b_from_a) {
  return {(c_from_b.rotation * b_from_a.rotation).normalized(),
          c_from_b * b_from_a.translation};
}

// The motion of a rig between two times: the rotation of its axes, and the
// shift of its center.
struct RigMotion {
  Eigen::Quaterniond rotation = Eigen::Quaterniond::Identity();
  Eigen::Vector3d shift_in_world = Eigen::Vector3d::Zero();
};

// The pose of a rig after a motion.
inline Rigid3 Move(const Rigid3& rig_from_world, const RigMotion& motion) {
  return Rigid3::FromRotationAndCenter(
      motion.rotation * rig_from_world.rotation,
      rig_from_world.Center() + motion.shift_in_world);
}

// A similarity b_from_a: x_in_b = scale * rotation * x_in_a + translation.
struct Sim3 {
  double scale = 1.0;
  Eigen::Quaterniond rotation = Eigen::Quaterniond::Identity();
  Eigen::Vector3d translation = Eigen::Vector3d::Zero();

  Sim3 Inverse() const {
    const Eigen::Quaterniond inverse = rotation.conjugate();
    return {1.0 / scale, inverse, -(inverse * translation) / scale};
  }
};

inline Eigen::Vector3d operator*(const Sim3& b_from_a,
                                 const Eigen::Vector3d& x_in_a) {
  return b_from_a.scale * (b_from_a.rotation * x_in_a) + b_from_a.translation;
}

// The pose of a camera after a similarity transform of its world:
// cam_from_new = TransformWorld(new_from_old, cam_from_old). Lengths in the
// camera frame are scaled, too.
inline Rigid3 TransformWorld(const Sim3& new_from_old,
                             const Rigid3& cam_from_old) {
  const Eigen::Quaterniond cam_from_new =
      (cam_from_old.rotation * new_from_old.rotation.conjugate()).normalized();
  return Rigid3::FromRotationAndCenter(cam_from_new,
                                       new_from_old * cam_from_old.Center());
}

}  // namespace mgsfm

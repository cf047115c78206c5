// SPDX-License-Identifier: BSD-3-Clause
#include "moving_objects/measured_motion.h"

#include <gtest/gtest.h>

#include "geometry/so3.h"

namespace mgsfm {
namespace {

using Eigen::Vector3d;

// Finite differences of the motion of a pose, or of its inverse.
TEST(MeasuredMotionTest, CovariancesFollowTheMotion) {
  const Rigid3 pose{ExpSO3({0.3, -0.2, 0.5}), {1.0, -2.0, 0.7}};
  for (const bool is_reversed : {false, true}) {
    const auto motion_of = [&](const Rigid3& p) {
      return is_reversed ? p.Inverse() : p;
    };
    const Rigid3 motion = motion_of(pose);
    for (int k = 0; k < 6; ++k) {
      constexpr double kStep = 1e-6;
      Eigen::Matrix<double, 6, 1> step = Eigen::Matrix<double, 6, 1>::Zero();
      step[k] = kStep;
      const Rigid3 moved = motion_of({ExpSO3(step.head<3>()) * pose.rotation,
                                      pose.translation + step.tail<3>()});
      const Vector3d turn =
          LogSO3(moved.rotation * motion.rotation.conjugate()) / kStep;
      const Vector3d shift = (moved.Center() - motion.Center()) / kStep;
      Eigen::Matrix<double, 6, 6> covariance =
          Eigen::Matrix<double, 6, 6>::Zero();
      covariance(k, k) = 1.0;
      const MeasuredMotion measured =
          MeasuredMotionOf(pose, covariance, is_reversed);
      EXPECT_TRUE(measured.rotation_covariance.isApprox(turn * turn.transpose(),
                                                        1e-4) ||
                  turn.isZero(1e-6));
      EXPECT_LT((measured.center_covariance - shift * shift.transpose()).norm(),
                1e-4);
    }
  }
}

// Finite differences of two motions, one after the other. Errors are rotation
// vectors in the later frame, and centers in the earlier one.
TEST(MeasuredMotionTest, CovariancesOfCompositionsFollowBothMotions) {
  const MeasuredMotion motions[] = {
      {{ExpSO3({0.3, -0.2, 0.5}), {1.0, -2.0, 0.7}}},
      {{ExpSO3({-0.4, 0.1, 0.2}), {-0.5, 0.6, 3.0}}}};
  const Rigid3 whole = Compose(motions[1], motions[0]).later_from_earlier;
  constexpr double kStep = 1e-6;
  for (int m = 0; m < 2; ++m) {
    for (int k = 0; k < 6; ++k) {
      MeasuredMotion moved[] = {motions[0], motions[1]};
      Rigid3& motion = moved[m].later_from_earlier;
      const Vector3d step = kStep * Vector3d::Unit(k % 3);
      motion = k < 3 ? Rigid3::FromRotationAndCenter(
                           ExpSO3(step) * motion.rotation, motion.Center())
                     : Rigid3::FromRotationAndCenter(motion.rotation,
                                                     motion.Center() + step);
      (k < 3 ? moved[m].rotation_covariance : moved[m].center_covariance)(
          k % 3, k % 3) = 1.0;
      const MeasuredMotion composed = Compose(moved[1], moved[0]);
      const Vector3d turn = LogSO3(composed.later_from_earlier.rotation *
                                   whole.rotation.conjugate()) /
                            kStep;
      const Vector3d shift =
          (composed.later_from_earlier.Center() - whole.Center()) / kStep;
      EXPECT_LT((composed.rotation_covariance - turn * turn.transpose()).norm(),
                1e-4);
      EXPECT_LT((composed.center_covariance - shift * shift.transpose()).norm(),
                1e-4);
    }
  }
}

}  // namespace
}  // namespace mgsfm

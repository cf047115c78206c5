// SPDX-License-Identifier: BSD-3-Clause
#include "soft_rig/rig_trajectory.h"

#include <gtest/gtest.h>

#include <cmath>

#include "geometry/so3.h"

namespace mgsfm {
namespace {

using Eigen::Vector3d;

// A smooth path that turns about all axes.
Rigid3 SmoothPose(double time_s) {
  return Rigid3::FromRotationAndCenter(
      ExpSO3({0.3 * std::sin(time_s), 0.8 * std::sin(0.7 * time_s), 0.2}) *
          ExpSO3({0.1, 0.4 * time_s, -0.2 * std::cos(time_s)}),
      {5.0 * time_s, std::cos(time_s), 3.0 * std::sin(0.5 * time_s)});
}

double Distance(const Rigid3& a, const Rigid3& b) {
  return AngleBetween(a.rotation, b.rotation) +
         (a.Center() - b.Center()).norm();
}

RigTrajectory TrajectoryWithSpacing(double spacing_s) {
  std::vector<double> times_s;
  std::vector<Rigid3> poses;
  double time_s = 1.0;
  for (int i = 0; time_s < 9.0; ++i) {
    times_s.push_back(time_s);
    poses.push_back(SmoothPose(time_s));
    time_s += spacing_s * (i % 3 == 0 ? 1.3 : 0.9);
  }
  return RigTrajectory(std::move(times_s), std::move(poses));
}

double MaxError(const RigTrajectory& path) {
  double most = 0.0;
  for (double time_s = 3.0; time_s < 7.0; time_s += 0.01) {
    most = std::max(most, Distance(path.PoseAt(time_s), SmoothPose(time_s)));
  }
  return most;
}

TEST(RigTrajectoryTest, PassesThroughItsFrames) {
  const RigTrajectory path = TrajectoryWithSpacing(0.2);
  EXPECT_LT(Distance(path.PoseAt(1.0), SmoothPose(1.0)), 1e-9);
  EXPECT_LT(Distance(path.PoseAt(1.26), SmoothPose(1.26)), 1e-9);
  EXPECT_LT(Distance(path.PoseAt(1.44), SmoothPose(1.44)), 1e-9);
}

TEST(RigTrajectoryTest, ErrorFallsWithTheThirdPowerOfTheSpacing) {
  const double coarse = MaxError(TrajectoryWithSpacing(0.2));
  const double fine = MaxError(TrajectoryWithSpacing(0.1));
  EXPECT_LT(coarse, 0.02);
  EXPECT_LT(fine, coarse / 6.0);
}

TEST(RigTrajectoryTest, VelocityIsContinuous) {
  const RigTrajectory path = TrajectoryWithSpacing(0.3);
  constexpr double kStep = 1e-5;
  for (const double frame_s : {1.39, 1.66, 1.93}) {
    const auto rate = [&](double time_s) {
      const Rigid3 from = path.PoseAt(time_s - kStep);
      const Rigid3 to = path.PoseAt(time_s + kStep);
      Eigen::Matrix<double, 6, 1> rate;
      rate << LogSO3(to.rotation * from.rotation.conjugate()),
          to.Center() - from.Center();
      return Eigen::Matrix<double, 6, 1>(rate / (2.0 * kStep));
    };
    EXPECT_LT(
        (rate(frame_s - 1.1 * kStep) - rate(frame_s + 1.1 * kStep)).norm(),
        1e-2);
  }
}

TEST(RigTrajectoryTest, ConstantVelocityIsExactEverywhere) {
  const auto pose = [](double time_s) {
    return Rigid3::FromRotationAndCenter(
        ExpSO3(time_s * Vector3d(0.1, 0.5, -0.2)),
        Vector3d(1.0, 2.0, 3.0) + time_s * Vector3d(4.0, 0.0, 1.0));
  };
  const std::vector<double> times_s = {0.0, 0.5, 0.6, 1.5};
  std::vector<Rigid3> poses;
  for (const double time_s : times_s) poses.push_back(pose(time_s));
  const RigTrajectory path(times_s, poses);
  for (const double time_s : {-0.7, 0.0, 0.2, 0.55, 1.1, 1.5, 2.0}) {
    EXPECT_LT(Distance(path.PoseAt(time_s), pose(time_s)), 1e-9) << time_s;
    PoseVector velocity;
    velocity << 0.1, 0.5, -0.2, 4.0, 0.0, 1.0;
    EXPECT_LT((path.VelocityAt(time_s) - velocity).norm(), 1e-6) << time_s;
  }
  EXPECT_NEAR(path.MedianInterval(), 0.5, 1e-12);
}

TEST(RigTrajectoryTest, OneFrameStands) {
  const RigTrajectory path({2.0}, {SmoothPose(2.0)});
  EXPECT_LT(Distance(path.PoseAt(5.0), SmoothPose(2.0)), 1e-12);
  EXPECT_TRUE(path.VelocityAt(5.0).isZero(0.0));
  EXPECT_TRUE(std::isinf(path.MedianInterval()));
}

}  // namespace
}  // namespace mgsfm

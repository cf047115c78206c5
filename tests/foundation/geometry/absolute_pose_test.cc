// SPDX-License-Identifier: BSD-3-Clause
#include "geometry/absolute_pose.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <limits>
#include <vector>

#include "geometry/so3.h"

namespace mgsfm {
namespace {

using Eigen::Vector3d;

const Rigid3 kPose{ExpSO3({0.4, -1.2, 0.3}), {3.0, -2.0, 5.0}};

std::vector<Rigid3> OneCamera() { return {Rigid3()}; }
// Three cameras with different centers and viewing directions.
std::vector<Rigid3> ThreeCameras() {
  return {Rigid3(),
          {ExpSO3({0.0, 1.2, 0.1}), {0.5, 0.1, -0.3}},
          {ExpSO3({0.1, -1.4, 0.0}), {-0.6, 0.2, 0.4}}};
}

Vector3d Noise(double sigma, Random* random) {
  return sigma * Vector3d(random->Normal(), random->Normal(), random->Normal());
}
Vector3d RandomRay(Random* random) {
  return (Vector3d::UnitZ() + Noise(0.5, random)).normalized();
}
double DistanceOf(const Rigid3& a, const Rigid3& b) {
  return AngleBetween(a.rotation, b.rotation) +
         (a.Center() - b.Center()).norm();
}

// Each camera has num_true correct and num_false random correspondences.
std::vector<CameraPoints> See(const std::vector<Rigid3>& cameras, int num_true,
                              int num_false, double noise_rad, Random* random) {
  std::vector<CameraPoints> seen;
  for (const Rigid3& cam_from_unit : cameras) {
    CameraPoints camera{cam_from_unit, {}, {}, 4e-3};
    const Rigid3 world_from_cam = (cam_from_unit * kPose).Inverse();
    for (int i = 0; i < num_true + num_false; ++i) {
      const Vector3d ray = RandomRay(random);
      const Vector3d shown = i < num_true ? ray : RandomRay(random);
      camera.rays.push_back((ray + Noise(noise_rad, random)).normalized());
      camera.points.push_back(world_from_cam *
                              (random->Uniform(2.0, 20.0) * shown));
    }
    seen.push_back(std::move(camera));
  }
  return seen;
}

TEST(AbsolutePose, ThreePointsGiveThePoseAndOnlyExactOnes) {
  Random random(1);
  for (int trial = 0; trial < 500; ++trial) {
    const CameraPoints camera = See(OneCamera(), 3, 0, 0.0, &random).front();
    const std::array<Vector3d, 3> rays = {camera.rays[0], camera.rays[1],
                                          camera.rays[2]};
    const std::array<Vector3d, 3> points = {camera.points[0], camera.points[1],
                                            camera.points[2]};
    std::array<Rigid3, 4> poses;
    const int num_poses = SolveP3P(rays, points, &poses);
    double best = std::numeric_limits<double>::infinity();
    for (int i = 0; i < num_poses; ++i) {
      best = std::min(best, DistanceOf(poses[i], kPose));
      for (int k = 0; k < 3; ++k) {
        EXPECT_LT(((poses[i] * points[k]).normalized() - rays[k]).norm(), 1e-6);
      }
    }
    EXPECT_LT(best, 1e-4) << trial;
  }
}

// On the axis of an equilateral triangle all depths are equal, and the linear
// equation for one depth vanishes.
TEST(AbsolutePose, ThreePointsInSymmetryGiveThePose) {
  std::array<Vector3d, 3> points, rays;
  for (int k = 0; k < 3; ++k) {
    const double angle = 2.0 * kPi * k / 3.0;
    points[k] = {std::cos(angle), std::sin(angle), 4.0};
    rays[k] = points[k].normalized();
  }
  std::array<Rigid3, 4> poses;
  const int num_poses = SolveP3P(rays, points, &poses);
  double best = std::numeric_limits<double>::infinity();
  for (int i = 0; i < num_poses; ++i) {
    best = std::min(best, DistanceOf(poses[i], Rigid3()));
  }
  EXPECT_LT(best, 1e-4);
}

TEST(AbsolutePose, PointsOnALineGiveNone) {
  const std::array<Vector3d, 3> points = {Vector3d(0, 0, 4), Vector3d(1, 0, 5),
                                          Vector3d(2, 0, 6)};
  std::array<Vector3d, 3> rays;
  for (int k = 0; k < 3; ++k) rays[k] = points[k].normalized();
  std::array<Rigid3, 4> poses;
  EXPECT_EQ(SolveP3P(rays, points, &poses), 0);
}

class AbsolutePoseOfUnits
    : public testing::TestWithParam<std::vector<Rigid3> (*)()> {};

TEST_P(AbsolutePoseOfUnits, IsExactWithoutNoise) {
  Random random(2);
  const auto cameras = See(GetParam()(), 20, 0, 0.0, &random);
  const auto pose = EstimateAbsolutePose(cameras, RansacOptions(), &random);
  ASSERT_TRUE(pose);
  EXPECT_LT(DistanceOf(*pose, kPose), 1e-7);
  EXPECT_EQ(ScoreAbsolutePose(cameras, *pose).num_inliers,
            20 * static_cast<int>(cameras.size()));
}

TEST_P(AbsolutePoseOfUnits, IsFoundAmongMoreWrongPoints) {
  Random random(3);
  const auto cameras = See(GetParam()(), 60, 90, 5e-4, &random);
  const auto pose = EstimateAbsolutePose(cameras, RansacOptions(), &random);
  ASSERT_TRUE(pose);
  EXPECT_LT(AngleBetween(pose->rotation, kPose.rotation), 1e-3);
  EXPECT_LT((pose->Center() - kPose.Center()).norm(), 0.01);
  EXPECT_GE(ScoreAbsolutePose(cameras, *pose).num_inliers,
            60 * static_cast<int>(cameras.size()));
}

// The refinement converges to a minimum of the cost.
TEST_P(AbsolutePoseOfUnits, RefinementEndsAtAMinimum) {
  Random random(4);
  const auto cameras = See(GetParam()(), 40, 0, 1e-3, &random);
  Rigid3 pose{(ExpSO3({0.01, 0.02, -0.01}) * kPose.rotation).normalized(),
              kPose.translation + Vector3d(0.05, -0.05, 0.1)};
  const SolveSummary best = RefineAbsolutePose(cameras, 0.5, &pose);
  ASSERT_TRUE(best.IsUsable());
  EXPECT_LT(best.final_cost, best.initial_cost);
  for (int axis = 0; axis < 6; ++axis) {
    for (const double step : {-1e-3, 1e-3}) {
      Rigid3 moved = pose;
      Vector3d delta = Vector3d::Zero();
      delta[axis % 3] = step;
      if (axis < 3) {
        moved.rotation = ExpSO3(delta) * moved.rotation;
      } else {
        moved.translation += 10.0 * delta;
      }
      EXPECT_GT(RefineAbsolutePose(cameras, 0.5, &moved).initial_cost,
                best.final_cost);
    }
  }
}

INSTANTIATE_TEST_SUITE_P(CentralAndNot, AbsolutePoseOfUnits,
                         testing::Values(&OneCamera, &ThreeCameras));

// A camera with too few points for a sample contributes to the score.
TEST(AbsolutePose, CamerasWithFewPointsCount) {
  Random random(5);
  auto cameras = See(ThreeCameras(), 30, 0, 5e-4, &random);
  cameras[1].rays.resize(2);
  cameras[1].points.resize(2);
  const auto pose = EstimateAbsolutePose(cameras, RansacOptions(), &random);
  ASSERT_TRUE(pose);
  EXPECT_EQ(ScoreAbsolutePose(cameras, *pose).num_inliers, 62);
  EXPECT_EQ(AbsolutePoseErrors(cameras, *pose).size(), 62u);
}

// Points at their triangulated places: the depth of far ones is uncertain.
std::vector<CameraPoints> SeeTriangulated(double noise_rad, Random* random) {
  constexpr double kBaseline = 0.5;
  CameraPoints camera = See(OneCamera(), 200, 0, noise_rad, random).front();
  camera.max_error_rad = noise_rad / kKeypointSigma;
  const Vector3d center = Vector3d::Zero();
  for (Vector3d& point : camera.points) {
    const Vector3d offset = point - center;
    const double relative_sigma = noise_rad * offset.norm() / kBaseline;
    camera.depth_sigmas.push_back(relative_sigma * offset);
    point += random->Normal() * camera.depth_sigmas.back();
  }
  return {camera};
}

double MiddleOf(std::vector<double> values) {
  std::sort(values.begin(), values.end());
  return values[values.size() / 2];
}

// Weighting by the variance halves the error of the center, at least.
TEST(AbsolutePose, UncertainDepthsHaveTheirWeights) {
  constexpr double kNoise_rad = 1.5e-3;
  Random random(7);
  std::vector<double> weighted, unweighted;
  for (int trial = 0; trial < 100; ++trial) {
    auto cameras = SeeTriangulated(kNoise_rad, &random);
    for (std::vector<double>* errors : {&weighted, &unweighted}) {
      Rigid3 pose = kPose;
      // Far beyond all errors: plain least squares.
      ASSERT_TRUE(RefineAbsolutePose(cameras, 1e3, &pose).IsUsable());
      errors->push_back((pose.Center() - kPose.Center()).norm());
      cameras.front().depth_sigmas.clear();
    }
  }
  EXPECT_LT(MiddleOf(weighted), 0.5 * MiddleOf(unweighted));
}

// At the true pose, errors have the variance of keypoints in both directions.
TEST(AbsolutePose, ErrorsOfUncertainDepthsHaveUnitVariance) {
  Random random(8);
  double sum = 0.0;
  size_t number = 0;
  for (int trial = 0; trial < 50; ++trial) {
    const auto cameras = SeeTriangulated(1e-3, &random);
    for (const double error : AbsolutePoseErrors(cameras, kPose)) {
      sum += error * error / (kKeypointSigma * kKeypointSigma);
      ++number;
    }
  }
  EXPECT_NEAR(sum / static_cast<double>(number), 2.0, 0.1);
}

TEST(AbsolutePose, VanishingUncertaintyIsThatOfExactPoints) {
  Random random(9);
  auto cameras = See(ThreeCameras(), 40, 0, 1e-3, &random);
  Rigid3 exact = kPose, uncertain = kPose;
  ASSERT_TRUE(RefineAbsolutePose(cameras, 0.5, &exact).IsUsable());
  for (CameraPoints& camera : cameras) {
    camera.depth_sigmas.assign(camera.size(), Vector3d::Constant(1e-12));
  }
  ASSERT_TRUE(RefineAbsolutePose(cameras, 0.5, &uncertain).IsUsable());
  EXPECT_LT(DistanceOf(exact, uncertain), 1e-8);
}

TEST(AbsolutePose, TooFewPointsGiveNone) {
  Random random(6);
  EXPECT_FALSE(EstimateAbsolutePose({}, RansacOptions(), &random));
  const auto cameras = See(ThreeCameras(), 2, 0, 0.0, &random);
  EXPECT_FALSE(EstimateAbsolutePose(cameras, RansacOptions(), &random));
  Rigid3 pose;
  EXPECT_FALSE(RefineAbsolutePose({}, 0.5, &pose).IsUsable());
}

}  // namespace
}  // namespace mgsfm

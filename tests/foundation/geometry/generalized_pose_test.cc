// SPDX-License-Identifier: BSD-3-Clause
#include "geometry/generalized_pose.h"

#include <gtest/gtest.h>

#include <vector>

#include "geometry/so3.h"

namespace mgsfm {
namespace {

const Rigid3 kMotion{ExpSO3({0.05, -0.2, 0.1}), {0.3, -0.2, 1.5}};

// Three cameras with different viewing directions.
std::vector<Rigid3> Cameras() {
  return {Rigid3(),
          {ExpSO3({0.0, 1.2, 0.1}), {0.5, 0.1, -0.3}},
          {ExpSO3({0.1, -1.4, 0.0}), {-0.6, 0.2, 0.4}}};
}

Eigen::Vector3d Noisy(const Eigen::Vector3d& ray, double noise_rad,
                      Random* random) {
  return (ray.normalized() + noise_rad * Eigen::Vector3d(random->Normal(),
                                                         random->Normal(),
                                                         random->Normal()))
      .normalized();
}

Eigen::Vector3d RandomRay(Random* random) {
  return Noisy({0.0, 0.0, 1.0}, 0.5, random);
}

// One pair per camera with num_true matches of points in all directions and
// num_false random matches.
std::vector<UnitMatches> Simulate(size_t num_true, size_t num_false,
                                  double noise_rad, Random* random) {
  std::vector<UnitMatches> pairs;
  for (const Rigid3& cam_from_unit : Cameras()) {
    UnitMatches pair{cam_from_unit, cam_from_unit, {}, 4e-3};
    while (pair.rays.size() < num_true) {
      const Eigen::Vector3d point_in_cam1 =
          random->Uniform(2.0, 12.0) * RandomRay(random);
      const Eigen::Vector3d point_in_cam2 =
          cam_from_unit * (kMotion * (cam_from_unit.Inverse() * point_in_cam1));
      pair.rays.Add(Noisy(point_in_cam1, noise_rad, random),
                    Noisy(point_in_cam2, noise_rad, random));
    }
    for (size_t i = 0; i < num_false; ++i) {
      pair.rays.Add(RandomRay(random), RandomRay(random));
    }
    pairs.push_back(std::move(pair));
  }
  return pairs;
}

double RotationError(const Rigid3& motion) {
  return AngleBetween(motion.rotation, kMotion.rotation);
}
double PositionError(const Rigid3& motion) {
  return (motion.translation - kMotion.translation).norm();
}

TEST(GeneralizedPose, RefinementFindsRotationAndLength) {
  Random random(1);
  const auto pairs = Simulate(30, 0, 0.0, &random);
  Rigid3 motion{(ExpSO3({0.01, 0.02, -0.01}) * kMotion.rotation).normalized(),
                1.1 * kMotion.translation};
  const SolveSummary summary = RefineUnitPose(pairs, &motion);
  EXPECT_TRUE(summary.IsUsable());
  EXPECT_LT(RotationError(motion), 1e-6);
  EXPECT_LT(PositionError(motion), 1e-5);
  EXPECT_EQ(ScoreUnitPose(pairs, motion).num_inliers, 90);
}

// The refinement of noisy matches converges to a minimum of the cost.
TEST(GeneralizedPose, RefinementEndsAtMinimum) {
  Random random(2);
  const auto pairs = Simulate(40, 0, 1e-3, &random);
  Rigid3 motion = kMotion;
  const SolveSummary best = RefineUnitPose(pairs, &motion);
  EXPECT_LT(best.final_cost, best.initial_cost);
  for (int axis = 0; axis < 6; ++axis) {
    for (const double step : {-2e-3, 2e-3}) {
      Rigid3 moved = motion;
      Eigen::Vector3d delta = Eigen::Vector3d::Zero();
      delta[axis % 3] = step;
      if (axis < 3) {
        moved.rotation = ExpSO3(delta) * moved.rotation;
      } else {
        moved.translation += 10.0 * delta;
      }
      EXPECT_GT(RefineUnitPose(pairs, &moved).initial_cost, best.final_cost);
    }
  }
}

TEST(GeneralizedPose, SamplesFindMotionAmongWrongMatches) {
  Random random(3);
  // No single pair has many matches.
  const auto pairs = Simulate(12, 10, 5e-4, &random);
  const auto motion = EstimateUnitPose(pairs, {}, RansacOptions(), &random);
  ASSERT_TRUE(motion);
  EXPECT_LT(RotationError(*motion), 5e-3);
  EXPECT_LT(PositionError(*motion), 0.1);
  for (const UnitMatches& pair : pairs) {
    const auto is_inlier = FindUnitInliers(pair, *motion);
    for (size_t i = 0; i < 12; ++i) EXPECT_TRUE(is_inlier[i]);
  }
}

TEST(GeneralizedPose, GuessNeedsTheLengthOnly) {
  Random random(4);
  const auto pairs = Simulate(40, 5, 5e-4, &random);
  const Rigid3 cam = Cameras()[1];
  Rigid3 guess = cam * kMotion * cam.Inverse();
  guess.translation.normalize();
  RansacOptions options;
  options.max_num_trials = 0;
  const auto motion = EstimateUnitPose(pairs, {{1, guess}}, options, &random);
  ASSERT_TRUE(motion);
  EXPECT_LT(RotationError(*motion), 2e-3);
  EXPECT_LT(PositionError(*motion), 0.02);
  EXPECT_FALSE(EstimateUnitPose({}, {}, RansacOptions(), &random));
}

// A static unit: the pairs have no baseline.
TEST(GeneralizedPose, StandingUnitHasRotation) {
  Random random(5);
  UnitMatches pair;
  for (int i = 0; i < 20; ++i) {
    const Eigen::Vector3d ray = RandomRay(&random);
    pair.rays.Add(ray, kMotion.rotation * ray);
  }
  const Rigid3 turn{kMotion.rotation, Eigen::Vector3d::Zero()};
  EXPECT_EQ(ScoreUnitPose({pair}, turn).num_inliers, 20);
  EXPECT_EQ(ScoreUnitPose({pair}, Rigid3()).num_inliers, 0);
}

}  // namespace
}  // namespace mgsfm

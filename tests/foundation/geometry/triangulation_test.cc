// SPDX-License-Identifier: BSD-3-Clause
#include "geometry/triangulation.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <limits>

#include "base/random.h"
#include "geometry/so3.h"

namespace mgsfm {
namespace {

using Eigen::Vector3d;

struct Problem {
  std::vector<Vector3d> centers;
  std::vector<Vector3d> rays;
  Vector3d point = Vector3d::Zero();
};

Vector3d RandomVector(Random* random) {
  return {random->Normal(), random->Normal(), random->Normal()};
}

// Views of a point at distance 10 along a line of length 4. The num_outliers
// central rays have an error of 0.15 rad, the others of noise_rad.
Problem MakeProblem(int size, int num_outliers, double noise_rad,
                    uint64_t seed) {
  Random random(seed);
  Problem problem;
  problem.point = Vector3d(random.Uniform(-2, 2), random.Uniform(-2, 2), 10.0);
  for (int k = 0; k < size; ++k) {
    const Vector3d center(-2.0 + 4.0 * k / (size - 1),
                          random.Uniform(-0.2, 0.2), random.Uniform(-0.2, 0.2));
    const Vector3d ray = (problem.point - center).normalized();
    const double error = k >= size / 2 - 1 && k < size / 2 - 1 + num_outliers
                             ? 0.15
                             : noise_rad * random.Normal();
    const Vector3d axis = ray.cross(RandomVector(&random)).normalized();
    problem.centers.push_back(center);
    problem.rays.push_back(ExpSO3(error * axis) * ray);
  }
  return problem;
}

TEST(TriangulationTest, ExactRaysGiveThePoint) {
  for (uint64_t seed = 0; seed < 20; ++seed) {
    const Problem p = MakeProblem(5, 0, 0.0, seed);
    const auto midpoint = TriangulateMidpoint(p.centers, p.rays);
    const auto l1 = TriangulateL1(p.centers, p.rays);
    const auto two =
        TriangulateTwoRays(p.centers[0], p.rays[0], p.centers[4], p.rays[4]);
    const auto robust = TriangulateRobust(p.centers, p.rays, {0.01, 0.1});
    ASSERT_TRUE(midpoint && l1 && two && robust);
    EXPECT_LT((*midpoint - p.point).norm(), 1e-11);
    EXPECT_LT((*l1 - p.point).norm(), 1e-11);
    EXPECT_LT((*two - p.point).norm(), 1e-11);
    EXPECT_LT((robust->point - p.point).norm(), 1e-11);
    EXPECT_EQ(robust->num_inliers, 5);
  }
}

TEST(TriangulationTest, TwoRaysIsTheMidpoint) {
  const Problem p = MakeProblem(2, 0, 0.02, 3);
  const auto midpoint = TriangulateMidpoint(p.centers, p.rays);
  const auto two =
      TriangulateTwoRays(p.centers[0], p.rays[0], p.centers[1], p.rays[1]);
  ASSERT_TRUE(midpoint && two);
  EXPECT_LT((*midpoint - *two).norm(), 1e-10);
}

TEST(TriangulationTest, L1AndRobustResistWrongRays) {
  for (uint64_t seed = 0; seed < 50; ++seed) {
    const Problem p = MakeProblem(8, 2, 0.0, seed);
    const auto l1 = TriangulateL1(p.centers, p.rays);
    const auto robust = TriangulateRobust(p.centers, p.rays, {0.01, 0.0});
    ASSERT_TRUE(l1 && robust) << seed;
    EXPECT_LT((*l1 - p.point).norm(), 1e-4) << seed;
    EXPECT_LT((robust->point - p.point).norm(), 1e-9) << seed;
    EXPECT_EQ(robust->num_inliers, 6);
    EXPECT_FALSE(robust->is_inlier[3] || robust->is_inlier[4]);
  }
}

TEST(TriangulationTest, RobustSamplesManyRays) {
  const Problem p = MakeProblem(40, 16, 0.001, 7);
  const auto robust = TriangulateRobust(p.centers, p.rays, {0.01, 0.0});
  ASSERT_TRUE(robust.has_value());
  EXPECT_EQ(robust->num_inliers, 24);
  EXPECT_LT((robust->point - p.point).norm(), 0.05);
}

TEST(TriangulationTest, L1IsTheMinimum) {
  Random random(1);
  for (uint64_t seed = 0; seed < 10; ++seed) {
    const Problem p = MakeProblem(7, 1, 0.005, seed);
    const auto l1 = TriangulateL1(p.centers, p.rays);
    ASSERT_TRUE(l1.has_value());
    const auto cost = [&](const Vector3d& x) {
      double sum = 0.0;
      for (size_t k = 0; k < p.rays.size(); ++k) {
        sum += p.rays[k].cross(x - p.centers[k]).norm() /
               (*l1 - p.centers[k]).norm();
      }
      return sum;
    };
    double best_other = std::numeric_limits<double>::infinity();
    for (int i = 0; i < 200; ++i) {
      const double radius = std::pow(10.0, random.Uniform(-4.0, 0.0));
      best_other =
          std::min(best_other, cost(*l1 + radius * RandomVector(&random)));
    }
    EXPECT_LE(cost(*l1), best_other + 1e-7);
  }
}

TEST(TriangulationTest, MovesAndScalesWithTheInput) {
  const Problem p = MakeProblem(8, 2, 0.002, 5);
  const auto l1 = TriangulateL1(p.centers, p.rays);
  const auto robust = TriangulateRobust(p.centers, p.rays, {0.01, 0.0});
  ASSERT_TRUE(l1 && robust);
  const Vector3d shift(700.0, -300.0, 650.0);
  for (const double scale : {1e-3, 1.0, 1e3}) {
    Problem moved = p;
    for (Vector3d& center : moved.centers) center = scale * (center + shift);
    const auto moved_l1 = TriangulateL1(moved.centers, moved.rays);
    const auto moved_robust =
        TriangulateRobust(moved.centers, moved.rays, {0.01, 0.0});
    ASSERT_TRUE(moved_l1 && moved_robust);
    EXPECT_LT((*moved_l1 / scale - shift - *l1).norm(), 1e-7);
    EXPECT_LT((moved_robust->point / scale - shift - robust->point).norm(),
              1e-7);
  }
}

TEST(TriangulationTest, ParallelRaysAndPointsBehindGiveNothing) {
  const std::vector<Vector3d> centers = {Vector3d::Zero(), Vector3d::UnitX()};
  const std::vector<Vector3d> parallel = {Vector3d::UnitZ(), Vector3d::UnitZ()};
  EXPECT_FALSE(TriangulateMidpoint(centers, parallel).has_value());
  EXPECT_FALSE(TriangulateL1(centers, parallel).has_value());
  EXPECT_FALSE(TriangulateRobust(centers, parallel, {}).has_value());
  const std::vector<Vector3d> diverging = {Vector3d(-0.1, 0, 1).normalized(),
                                           Vector3d(0.1, 0, 1).normalized()};
  EXPECT_TRUE(TriangulateMidpoint(centers, diverging).has_value());
  EXPECT_FALSE(TriangulateL1(centers, diverging).has_value());
  EXPECT_FALSE(TriangulateRobust(centers, diverging, {}).has_value());
  EXPECT_FALSE(TriangulateL1({centers[0]}, {parallel[0]}).has_value());
  EXPECT_FALSE(
      TriangulateL1({centers[0], centers[0]}, diverging).has_value() &&
      TriangulateRobust({centers[0], centers[0]}, diverging, {0.01, 0.01}));
}

TEST(TriangulationTest, AnglesAreGeometric) {
  EXPECT_NEAR(AngularError(Vector3d::Zero(), Vector3d::UnitZ(), {1, 0, 1}),
              kPi / 4, 1e-12);
  EXPECT_DOUBLE_EQ(
      AngularError(Vector3d::Zero(), Vector3d::UnitZ(), Vector3d::Zero()), kPi);
  EXPECT_NEAR(MaxTriangulationAngle({{-1, 0, 0}, {0, 0, 0}, {1, 0, 0}},
                                    Vector3d(0, 0, 1)),
              kPi / 2, 1e-12);
}

TEST(TriangulationTest, LargestAngleIsThatOfAllPairs) {
  Random random(3);
  for (int trial = 0; trial < 50; ++trial) {
    const Vector3d point = RandomVector(&random);
    std::vector<Vector3d> centers;
    double largest = 0.0;
    for (int i = 0; i < 7; ++i) {
      // Large distances give small angles.
      centers.push_back(point + Vector3d(0, 0, std::pow(10.0, trial % 5)) +
                        RandomVector(&random));
      for (int k = 0; k < i; ++k) {
        largest = std::max(largest, AngleBetween(Vector3d(centers[i] - point),
                                                 Vector3d(centers[k] - point)));
      }
    }
    EXPECT_NEAR(MaxTriangulationAngle(centers, point), largest,
                1e-12 + 1e-7 * std::max(0.0, largest - 3.0));
    const double enough = 0.5 * largest;
    EXPECT_GE(MaxTriangulationAngle(centers, point, enough), enough);
    EXPECT_LT(MaxTriangulationAngle(centers, point, 2.0 * largest),
              1.1 * largest);
  }
}

}  // namespace
}  // namespace mgsfm

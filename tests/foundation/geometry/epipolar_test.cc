// SPDX-License-Identifier: BSD-3-Clause
#include "geometry/epipolar.h"

#include <gtest/gtest.h>

#include <Eigen/Eigenvalues>
#include <algorithm>
#include <cmath>
#include <vector>

#include "geometry/epipolar_terms.h"
#include "geometry/so3.h"

namespace mgsfm {
namespace {

Eigen::Vector3d RandomVector(Random* random) {
  return {random->Normal(), random->Normal(), random->Normal()};
}

Rigid3 RandomPose(Random* random) {
  return {ExpSO3(0.3 * RandomVector(random)),
          RandomVector(random).normalized()};
}

// The distribution of points around camera 1.
enum class Layout { kAllAround, kAhead, kPlane, kFar };

struct TestOptions {
  Layout layout = Layout::kAllAround;
  int num_matches = 100;
  double noise_rad = 0.0;
  double outlier_ratio = 0.0;
};

Eigen::Vector3d RandomPoint(Layout layout, Random* random) {
  const double u = random->Uniform(-1.0, 1.0), v = random->Uniform(-1.0, 1.0);
  switch (layout) {
    case Layout::kAllAround:
      return random->Uniform(3.0, 20.0) * RandomVector(random).normalized();
    case Layout::kAhead:
      return random->Uniform(4.0, 20.0) * Eigen::Vector3d(u, v, 1.0);
    case Layout::kPlane:
      return {6.0 * u, 6.0 * v, 8.0 + 2.0 * u - 1.0 * v};
    case Layout::kFar:
      return 1e9 * Eigen::Vector3d(u, v, 1.0).normalized();
  }
  return Eigen::Vector3d::Zero();
}

Eigen::Vector3d AddNoise(const Eigen::Vector3d& ray, double noise_rad,
                         Random* random) {
  return (ray + noise_rad * RandomVector(random)).normalized();
}

RayMatches MakeMatches(const Rigid3& cam2_from_cam1, const TestOptions& options,
                       Random* random) {
  RayMatches matches;
  for (int i = 0; i < options.num_matches; ++i) {
    const Eigen::Vector3d point = RandomPoint(options.layout, random);
    Eigen::Vector3d ray2 = (cam2_from_cam1 * point).normalized();
    if (random->Uniform() < options.outlier_ratio) {
      ray2 = RandomPoint(options.layout, random).normalized();
    }
    matches.Add(AddNoise(point.normalized(), options.noise_rad, random),
                AddNoise(ray2, options.noise_rad, random));
  }
  return matches;
}

void ExpectSamePose(const Rigid3& actual, const Rigid3& expected,
                    double tolerance_rad) {
  EXPECT_LE(AngleBetween(actual.rotation, expected.rotation), tolerance_rad);
  EXPECT_LE(AngleBetween(actual.translation, expected.translation),
            tolerance_rad);
}

// Two motions induce the same homography of a plane.
std::vector<Rigid3> PossiblePoses(const Rigid3& pose, Layout layout) {
  if (layout != Layout::kPlane) return {pose};
  const Eigen::Vector3d plane(-2.0 / 6.0 / 8.0, 1.0 / 6.0 / 8.0, 1.0 / 8.0);
  std::vector<Rigid3> poses;
  for (const PlanarMotion& motion :
       DecomposeHomography(pose.rotation.toRotationMatrix() +
                           pose.translation * plane.transpose())) {
    poses.push_back(motion.cam2_from_cam1);
  }
  return poses;
}

double Distance(const Rigid3& a, const Rigid3& b) {
  return AngleBetween(a.rotation, b.rotation) +
         AngleBetween(a.translation, b.translation);
}

TEST(EpipolarTest, EssentialVanishesOnMatches) {
  Random random(1);
  const Rigid3 pose = RandomPose(&random);
  const RayMatches matches = MakeMatches(pose, {}, &random);
  const Eigen::Matrix3d E = EssentialFromPose(pose);
  EXPECT_NEAR(E.norm(), std::sqrt(2.0), 1e-12);
  for (size_t i = 0; i < matches.size(); ++i) {
    EXPECT_NEAR(matches.rays2[i].dot(E * matches.rays1[i]), 0.0, 1e-14);
    EXPECT_NEAR(SampsonAngle(pose, matches.rays1[i], matches.rays2[i]), 0.0,
                1e-13);
    EXPECT_TRUE(IsInFront(pose, matches.rays1[i], matches.rays2[i], 0.0));
  }
}

TEST(EpipolarTest, OnlyOneDecompositionOfEssentialHasPointsInFront) {
  Random random(2);
  for (int trial = 0; trial < 50; ++trial) {
    const Rigid3 pose = RandomPose(&random);
    const RayMatches matches = MakeMatches(pose, {}, &random);
    const double scale = trial % 2 == 0 ? 3.0 : -0.2;
    int num_found = 0;
    for (const Rigid3& candidate :
         DecomposeEssential(scale * EssentialFromPose(pose))) {
      const PoseScore score = ScoreRelativePose(matches, candidate, 1e-6);
      if (Distance(candidate, pose) < 1e-9) {
        ++num_found;
        EXPECT_EQ(score.num_inliers, static_cast<int>(matches.size()));
      } else {
        EXPECT_EQ(score.num_inliers, 0);
      }
    }
    EXPECT_EQ(num_found, 1);
  }
}

// Compares IsInFront with explicitly computed distances along the rays.
TEST(EpipolarTest, InFrontMeansPositiveDistances) {
  Random random(3);
  for (int trial = 0; trial < 500; ++trial) {
    const Rigid3 pose = RandomPose(&random);
    const Eigen::Vector3d point = 2.0 * RandomVector(&random);
    const double sign1 = random.Uniform() < 0.5 ? -1.0 : 1.0;
    const double sign2 = random.Uniform() < 0.5 ? -1.0 : 1.0;
    const Eigen::Vector3d ray1 = sign1 * point.normalized();
    const Eigen::Vector3d ray2 = sign2 * (pose * point).normalized();
    EXPECT_EQ(IsInFront(pose, ray1, ray2, 0.0), sign1 > 0.0 && sign2 > 0.0);
  }
}

TEST(EpipolarTest, PointsAtInfinityAreInFrontWithinTolerance) {
  Random random(4);
  const Rigid3 pose = RandomPose(&random);
  const RayMatches matches =
      MakeMatches(pose, {Layout::kFar, 100, 1e-4, 0.0}, &random);
  EXPECT_EQ(ScoreRelativePose(matches, pose, 1e-3).num_inliers, 100);
}

// To first order, the Sampson angle is the length of the smallest joint
// correction, which the test computes by constrained minimization.
TEST(EpipolarTest, SampsonAngleIsDistanceToNearestMatch) {
  Random random(5);
  for (int trial = 0; trial < 50; ++trial) {
    const Rigid3 pose = RandomPose(&random);
    const RayMatches noisy =
        MakeMatches(pose, {Layout::kAllAround, 1, 1e-4, 0.0}, &random);
    const Eigen::Matrix3d E = EssentialFromPose(pose);
    Eigen::Vector3d ray1 = noisy.rays1[0], ray2 = noisy.rays2[0];
    for (int i = 0; i < 20; ++i) {
      Eigen::Vector3d gradient1 = E.transpose() * ray2, gradient2 = E * ray1;
      gradient1 -= gradient1.dot(ray1) * ray1;
      gradient2 -= gradient2.dot(ray2) * ray2;
      const double step = ray2.dot(E * ray1) /
                          (gradient1.squaredNorm() + gradient2.squaredNorm());
      ray1 = (ray1 - step * gradient1).normalized();
      ray2 = (ray2 - step * gradient2).normalized();
    }
    const double correction = std::hypot((ray1 - noisy.rays1[0]).norm(),
                                         (ray2 - noisy.rays2[0]).norm());
    const double angle =
        std::abs(SampsonAngle(pose, noisy.rays1[0], noisy.rays2[0]));
    EXPECT_NEAR(angle, correction, 1e-3 * correction + 1e-12);
  }
}

TEST(EpipolarTest, SampsonJacobianMatchesFiniteDifferences) {
  Random random(6);
  for (int trial = 0; trial < 100; ++trial) {
    const Rigid3 pose = RandomPose(&random);
    // An arbitrary non-match, so that all terms contribute.
    const Eigen::Vector3d ray1 = RandomVector(&random).normalized();
    const Eigen::Vector3d ray2 = RandomVector(&random).normalized();
    Eigen::Matrix<double, 1, 5> jacobian;
    SampsonAngle(pose, ray1, ray2, &jacobian);
    for (int k = 0; k < 5; ++k) {
      constexpr double kStep = 1e-6;
      const Eigen::Matrix<double, 5, 1> delta =
          kStep * Eigen::Matrix<double, 5, 1>::Unit(k);
      const double numeric =
          (SampsonAngle(PerturbRelativePose(pose, delta), ray1, ray2) -
           SampsonAngle(PerturbRelativePose(pose, -delta), ray1, ray2)) /
          (2.0 * kStep);
      EXPECT_NEAR(jacobian(k), numeric, 1e-7 * (1.0 + std::abs(numeric)));
    }
  }
}

TEST(EpipolarTest, HomographyOfPlaneIsDecomposed) {
  Random random(7);
  for (int trial = 0; trial < 50; ++trial) {
    const Rigid3 pose{ExpSO3(0.2 * RandomVector(&random)),
                      0.3 * RandomVector(&random).normalized()};
    const Eigen::Vector3d normal =
        (Eigen::Vector3d::UnitZ() + 0.3 * RandomVector(&random)).normalized();
    const double scale = trial % 2 == 0 ? 5.0 : -0.1;
    const Eigen::Matrix3d H = scale * (pose.rotation.toRotationMatrix() +
                                       pose.translation * normal.transpose());
    const auto motions = DecomposeHomography(H);
    ASSERT_EQ(motions.size(), 4u);
    double best = 1.0;
    for (const PlanarMotion& motion : motions) {
      const Eigen::Matrix3d induced =
          motion.cam2_from_cam1.rotation.toRotationMatrix() +
          motion.cam2_from_cam1.translation * motion.plane_normal.transpose();
      EXPECT_NEAR((induced - H / scale).norm(), 0.0, 1e-8);
      best = std::min(
          best, Distance(motion.cam2_from_cam1, pose) +
                    (motion.plane_normal - normal).norm() +
                    std::abs(motion.cam2_from_cam1.translation.norm() - 0.3));
    }
    EXPECT_LE(best, 1e-7);
  }
}

TEST(EpipolarTest, PlanarTwinIsTheOtherMotionOfThePlane) {
  Random random(31);
  for (int trial = 0; trial < 20; ++trial) {
    const Rigid3 pose = RandomPose(&random);
    RayMatches matches = MakeMatches(
        pose, {Layout::kPlane, /*num_matches=*/160, /*noise_rad=*/1e-4},
        &random);
    const auto num_on_plane = static_cast<std::ptrdiff_t>(matches.size());
    const RayMatches elsewhere = MakeMatches(
        pose, {Layout::kAhead, /*num_matches=*/40, /*noise_rad=*/1e-4},
        &random);
    for (size_t i = 0; i < elsewhere.size(); ++i) {
      matches.Add(elsewhere.rays1[i], elsewhere.rays2[i]);
    }
    const auto twin = PlanarTwin(matches, pose, 2e-3);
    ASSERT_TRUE(twin.has_value());
    double least = 1.0;
    for (const Rigid3& possible : PossiblePoses(pose, Layout::kPlane)) {
      if (AngleBetween(possible.rotation, pose.rotation) < 1e-6) continue;
      const Rigid3 unit{possible.rotation, possible.translation.normalized()};
      least = std::min(least, Distance(*twin, unit));
    }
    EXPECT_LE(least, 0.01) << trial;
    // It explains the rays, although some points can lie behind a camera.
    const std::vector<double> errors = SampsonAngles(matches, *twin);
    EXPECT_LE(*std::max_element(errors.begin(), errors.begin() + num_on_plane),
              2e-3);
    const auto again = PlanarTwin(matches, *twin, 2e-3);
    ASSERT_TRUE(again.has_value());
    EXPECT_LE(Distance(*again, pose), 0.01) << trial;
  }
}

TEST(EpipolarTest, MatchesOffPlanesHaveNoPlanarTwin) {
  Random random(32);
  for (const Layout layout : {Layout::kAllAround, Layout::kAhead}) {
    const Rigid3 pose = RandomPose(&random);
    EXPECT_FALSE(PlanarTwin(MakeMatches(pose, {layout}, &random), pose, 2e-3));
  }
  EXPECT_FALSE(PlanarTwin({}, RandomPose(&random), 2e-3));
}

TEST(EpipolarTest, HomographyOfRotationIsDecomposed) {
  Random random(8);
  const Eigen::Quaterniond rotation = ExpSO3(RandomVector(&random));
  const auto motions = DecomposeHomography(-7.0 * rotation.toRotationMatrix());
  ASSERT_EQ(motions.size(), 1u);
  EXPECT_LE(AngleBetween(motions[0].cam2_from_cam1.rotation, rotation), 1e-9);
  EXPECT_EQ(motions[0].cam2_from_cam1.translation.norm(), 0.0);
}

TEST(EpipolarTest, SingularHomographyHasNoDecomposition) {
  EXPECT_TRUE(DecomposeHomography(Eigen::Matrix3d::Zero()).empty());
  EXPECT_TRUE(
      DecomposeHomography(Eigen::Vector3d(1, 1, 0).asDiagonal()).empty());
}

TEST(EpipolarTest, FivePointFindsThePoseAndOnlyEssentialsThroughTheMatches) {
  Random random(9);
  std::vector<double> errors;
  for (const Layout layout :
       {Layout::kAllAround, Layout::kAhead, Layout::kPlane}) {
    for (int trial = 0; trial < 50; ++trial) {
      const Rigid3 pose = RandomPose(&random);
      const RayMatches matches =
          MakeMatches(pose, {layout, 5, 0.0, 0.0}, &random);
      std::array<Eigen::Vector3d, 5> rays1, rays2;
      std::copy_n(matches.rays1.begin(), 5, rays1.begin());
      std::copy_n(matches.rays2.begin(), 5, rays2.begin());
      std::array<Eigen::Matrix3d, 10> essentials;
      const int num_solutions = SolveFivePoint(rays1, rays2, &essentials);
      ASSERT_GE(num_solutions, 1);
      double best = 1.0;
      for (int i = 0; i < num_solutions; ++i) {
        for (int k = 0; k < 5; ++k) {
          EXPECT_NEAR(rays2[k].dot(essentials[i] * rays1[k]), 0.0, 1e-9);
        }
        for (const Rigid3& candidate : DecomposeEssential(essentials[i])) {
          best = std::min(best, Distance(candidate, pose));
        }
      }
      errors.push_back(best);
    }
  }
  std::sort(errors.begin(), errors.end());
  EXPECT_LE(errors[errors.size() / 2], 1e-10);
  EXPECT_LE(errors.back(), 1e-5);  // of nearly degenerate samples
}

// Any number of matches, including rays on the baseline, for which the error is
// undefined.
TEST(EpipolarTest, SumsAreThoseOfSingleMatches) {
  Random random(23);
  const Rigid3 pose = RandomPose(&random);
  const double scale = 1e-2;
  const Eigen::Vector3d& t = pose.translation;
  Eigen::Matrix<double, 3, 2> basis;
  basis.col(0) = t.unitOrthogonal();
  basis.col(1) = t.cross(basis.col(0));
  for (int size = 1; size < 14; ++size) {
    RayMatches matches =
        MakeMatches(pose, {Layout::kAllAround, size, 1e-2, 0.0}, &random);
    if (size % 3 == 0) matches.Add(pose.rotation.conjugate() * t, t);
    Eigen::Matrix<double, 5, 5> hessian = Eigen::Matrix<double, 5, 5>::Zero();
    Eigen::Matrix<double, 5, 1> gradient = Eigen::Matrix<double, 5, 1>::Zero();
    double cost = 0.0;
    for (size_t i = 0; i < matches.size(); ++i) {
      Eigen::Matrix<double, 1, 5> J;
      const double r =
          SampsonAngle(pose, matches.rays1[i], matches.rays2[i], &J);
      const double weight = 1.0 / (1.0 + r * r / (scale * scale));
      hessian += weight * J.transpose() * J;
      gradient += weight * r * J.transpose();
      cost -= 0.5 * scale * scale * std::log(weight);
    }
    const internal::PoseSums sums = internal::SumSampsonTerms(
        matches, {pose.rotation.toRotationMatrix(), t}, basis, scale);
    EXPECT_LT((sums.hessian - hessian).norm(), 1e-10 * (1.0 + hessian.norm()));
    EXPECT_LT((sums.gradient - gradient).norm(), 1e-10);
    EXPECT_NEAR(sums.cost, cost, 1e-12 * (1.0 + cost));
  }
}

TEST(EpipolarTest, RefinementIsExactWithoutNoise) {
  Random random(10);
  for (const Layout layout :
       {Layout::kAllAround, Layout::kAhead, Layout::kPlane}) {
    for (int trial = 0; trial < 20; ++trial) {
      const Rigid3 pose = RandomPose(&random);
      const RayMatches matches =
          MakeMatches(pose, {layout, 200, 0.0, 0.0}, &random);
      Eigen::Matrix<double, 5, 1> delta;
      for (int k = 0; k < 5; ++k) delta(k) = 0.01 * random.Normal();
      Rigid3 refined = PerturbRelativePose(pose, delta);
      const SolveSummary summary = RefineRelativePose(matches, {}, &refined);
      EXPECT_EQ(summary.termination, Termination::kConverged);
      EXPECT_LE(summary.final_cost, summary.initial_cost);
      EXPECT_NEAR(refined.translation.norm(), 1.0, 1e-12);
      ExpectSamePose(refined, pose, 1e-8);
    }
  }
}

// Ten outliers have little weight next to a hundred matches in all directions.
TEST(EpipolarTest, RefinementIsRobust) {
  Random random(11);
  const Rigid3 pose = RandomPose(&random);
  const RayMatches matches =
      MakeMatches(pose, {Layout::kAllAround, 110, 1e-4, 0.1}, &random);
  Rigid3 refined = pose;
  EXPECT_TRUE(
      RefineRelativePose(matches, {2e-4, 50, 1e-9, 1e-9}, &refined).IsUsable());
  ExpectSamePose(refined, pose, 5e-4);
}

// Over repeated noise of rays, in a field of view of 20 degrees, the direction
// scatters as predicted if the rotation is fixed, and more if it is not.
TEST(EpipolarTest, DirectionScattersAsPredictedWithAFixedRotation) {
  constexpr int kNumTrials = 300;
  constexpr double kNoise_rad = 1e-3;
  Random random(13);
  const Rigid3 pose{ExpSO3({0.0, 0.1, 0.0}),
                    Eigen::Vector3d(0.9, 0.1, 0.3).normalized()};
  PoseRefinementOptions options;
  options.loss_scale_rad = kNoise_rad;
  Eigen::Matrix3d fixed = Eigen::Matrix3d::Zero();
  Eigen::Matrix3d free = Eigen::Matrix3d::Zero();
  double mean_sigma_rad = 0.0;
  for (int trial = 0; trial < kNumTrials; ++trial) {
    RayMatches matches;
    for (int i = 0; i < 60; ++i) {
      const Eigen::Vector3d point =
          random.Uniform(2.0, 10.0) *
          Eigen::Vector3d(random.Uniform(-0.17, 0.17),
                          random.Uniform(-0.17, 0.17), 1.0);
      matches.Add(AddNoise(point.normalized(), kNoise_rad, &random),
                  AddNoise((pose * point).normalized(), kNoise_rad, &random));
    }
    Rigid3 refined = pose;
    options.is_rotation_fixed = false;
    ASSERT_TRUE(RefineRelativePose(matches, options, &refined).IsUsable());
    Eigen::Vector3d error = refined.translation - pose.translation;
    free += error * error.transpose() / kNumTrials;
    options.is_rotation_fixed = true;
    refined = pose;
    ASSERT_TRUE(RefineRelativePose(matches, options, &refined).IsUsable());
    EXPECT_LT(AngleBetween(refined.rotation, pose.rotation), 1e-12);
    error = refined.translation - pose.translation;
    fixed += error * error.transpose() / kNumTrials;
    mean_sigma_rad += DirectionSigmaRad(matches, options, pose) / kNumTrials;
  }
  const auto largest_sigma = [](const Eigen::Matrix3d& covariance) {
    return std::sqrt(Eigen::SelfAdjointEigenSolver<Eigen::Matrix3d>(covariance)
                         .eigenvalues()[2]);
  };
  EXPECT_NEAR(largest_sigma(fixed) / mean_sigma_rad, 1.0, 0.25);
  EXPECT_LT(largest_sigma(fixed), 0.5 * largest_sigma(free));
}

TEST(EpipolarTest, RotationIsRefinedForAFixedDirection) {
  Random random(14);
  const Rigid3 pose = RandomPose(&random);
  const RayMatches matches =
      MakeMatches(pose, {Layout::kAhead, 50, 0.0, 0.0}, &random);
  PoseRefinementOptions options;
  options.is_direction_fixed = true;
  Rigid3 refined{ExpSO3({0.02, -0.01, 0.03}) * pose.rotation, pose.translation};
  ASSERT_TRUE(RefineRelativePose(matches, options, &refined).IsUsable());
  EXPECT_LT(AngleBetween(refined.rotation, pose.rotation), 1e-6);
  EXPECT_LT((refined.translation - pose.translation.normalized()).norm(),
            1e-12);
}

TEST(EpipolarTest, RefinementNeedsFiveMatches) {
  Random random(12);
  const Rigid3 pose = RandomPose(&random);
  Rigid3 refined = pose;
  const RayMatches matches =
      MakeMatches(pose, {Layout::kAhead, 4, 0.0, 0.0}, &random);
  EXPECT_FALSE(RefineRelativePose(matches, {}, &refined).IsUsable());
}

TEST(EpipolarTest, RansacFindsThePoseAmongOutliers) {
  for (const Layout layout :
       {Layout::kAllAround, Layout::kAhead, Layout::kPlane}) {
    for (uint64_t seed = 0; seed < 10; ++seed) {
      Random random(20, seed);
      const Rigid3 pose = RandomPose(&random);
      const RayMatches matches =
          MakeMatches(pose, {layout, 300, 3e-4, 0.4}, &random);
      RansacOptions options;
      options.max_error_rad = 1.5e-3;
      const auto estimate = EstimateRelativePose(matches, options, &random);
      ASSERT_TRUE(estimate);
      double best = 1.0;
      for (const Rigid3& possible : PossiblePoses(pose, layout)) {
        best = std::min(best, Distance(*estimate, possible));
      }
      EXPECT_LE(best, 2e-2);
    }
  }
}

TEST(EpipolarTest, RansacIsExactWithoutNoise) {
  Random random(21);
  const Rigid3 pose = RandomPose(&random);
  const auto estimate =
      EstimateRelativePose(MakeMatches(pose, {}, &random), {}, &random);
  ASSERT_TRUE(estimate);
  ExpectSamePose(*estimate, pose, 1e-8);
}

TEST(EpipolarTest, RansacIsDeterministicInItsSeed) {
  Random random(22);
  const Rigid3 pose = RandomPose(&random);
  const RayMatches matches =
      MakeMatches(pose, {Layout::kAhead, 200, 1e-3, 0.3}, &random);
  Random random1(5), random2(5);
  const auto estimate1 = EstimateRelativePose(matches, {}, &random1);
  const auto estimate2 = EstimateRelativePose(matches, {}, &random2);
  ASSERT_TRUE(estimate1 && estimate2);
  EXPECT_EQ(estimate1->rotation.coeffs(), estimate2->rotation.coeffs());
  EXPECT_EQ(estimate1->translation, estimate2->translation);
}

TEST(EpipolarTest, RansacOfTooFewMatchesIsNothing) {
  Random random(23);
  const RayMatches matches =
      MakeMatches(RandomPose(&random), {Layout::kAhead, 4, 0.0, 0.0}, &random);
  EXPECT_FALSE(EstimateRelativePose(matches, {}, &random));
  EXPECT_FALSE(EstimateRotation(RayMatches(), {}, &random));
}

TEST(EpipolarTest, RotationIsFoundAmongOutliers) {
  for (uint64_t seed = 0; seed < 10; ++seed) {
    Random random(30, seed);
    const Rigid3 pose{ExpSO3(RandomVector(&random)), Eigen::Vector3d::Zero()};
    const RayMatches matches =
        MakeMatches(pose, {Layout::kAllAround, 300, 3e-4, 0.4}, &random);
    RansacOptions options;
    options.max_error_rad = 1.5e-3;
    const auto estimate = EstimateRotation(matches, options, &random);
    ASSERT_TRUE(estimate);
    Eigen::Quaterniond refined = *estimate;
    EXPECT_TRUE(
        RefineRotation(matches, {3e-4, 50, 1e-9, 1e-9}, &refined).IsUsable());
    EXPECT_LE(AngleBetween(refined, pose.rotation), 2e-4);
  }
}

TEST(EpipolarTest, DirectionIsFoundGivenTheRotation) {
  Random random(32);
  const Rigid3 pose = RandomPose(&random);
  const Eigen::Vector3d direction =
      FitDirection(MakeMatches(pose, {}, &random), pose.rotation);
  EXPECT_NEAR(std::abs(direction.dot(pose.translation)), 1.0, 1e-12);
}

// Noisy matches of a pure rotation determine the rotation for any direction of
// the translation.
TEST(EpipolarTest, RansacOfPureRotationHasTheRotation) {
  for (uint64_t seed = 0; seed < 10; ++seed) {
    Random random(31, seed);
    const Rigid3 pose = RandomPose(&random);
    const RayMatches matches =
        MakeMatches(pose, {Layout::kFar, 300, 3e-4, 0.2}, &random);
    RansacOptions options;
    options.max_error_rad = 1.5e-3;
    const auto estimate = EstimateRelativePose(matches, options, &random);
    ASSERT_TRUE(estimate);
    EXPECT_LE(AngleBetween(estimate->rotation, pose.rotation), 5e-3);
  }
}

}  // namespace
}  // namespace mgsfm

// SPDX-License-Identifier: BSD-3-Clause
#include "matching/two_view_verification.h"

#include <gtest/gtest.h>

#include <Eigen/LU>
#include <algorithm>
#include <set>

#include "frontend/matching/simulated_pair.h"
#include "geometry/epipolar.h"
#include "geometry/so3.h"
#include "matching/ray_models.h"
#include "matching/scene_pairs.h"

namespace mgsfm {
namespace {

const Rigid3 kMotion{ExpSO3({0.03, -0.08, 0.02}), {1.0, 0.2, -0.4}};

Camera Pinhole(bool has_prior = true) {
  return MakeCamera(CameraModelId::kPinhole, 800, 600, {600, 605, 405, 298},
                    has_prior);
}

// The field of view is 200 degrees.
Camera Fisheye() {
  return MakeCamera(CameraModelId::kOpenCVFisheye, 700, 700,
                    {200, 200, 350, 350, 0.01, -0.002, 0.0, 0.0});
}

ImagePair Verify(const SimulatedPair& pair,
                 const TwoViewGeometryOptions& options = {}) {
  return VerifyPair(pair.view1.View(), pair.view2.View(), pair.matches, options,
                    Random(1));
}

size_t CountTrue(const ImagePair& verified, const SimulatedPair& pair) {
  return static_cast<size_t>(std::count_if(
      verified.matches.begin(), verified.matches.end(),
      [&](const Match& m) { return m.keypoint_idx1 < pair.num_true; }));
}

double RotationErrorDeg(const ImagePair& verified, const Rigid3& motion) {
  return RadToDeg(
      AngleBetween(verified.relative_pose->cam2_from_cam1, motion.rotation));
}

double DirectionErrorDeg(const ImagePair& verified, const Rigid3& motion) {
  return RadToDeg(AngleBetween(*verified.relative_pose->translation_direction,
                               motion.translation));
}

TEST(VerifyPair, GeneralSceneIsCalibrated) {
  Random random(1);
  const SimulatedPair pair =
      SimulatePair(Pinhole(), kMotion, {}, &random, DrawInBox);
  const ImagePair verified = Verify(pair);
  EXPECT_EQ(verified.config, TwoViewConfig::kCalibrated);
  EXPECT_GE(CountTrue(verified, pair), pair.num_true - 2);
  EXPECT_LE(verified.matches.size(), pair.num_true + 5);
  EXPECT_LT(RotationErrorDeg(verified, kMotion), 0.2);
  EXPECT_LT(DirectionErrorDeg(verified, kMotion), 2.0);
  ASSERT_TRUE(verified.E && verified.F);
  EXPECT_FALSE(verified.H);
  // F is in pixels: check distances to epipolar lines.
  for (const Match& match : verified.matches) {
    const Eigen::Vector3d x1 =
        pair.view1.keypoints[match.keypoint_idx1].cast<double>().homogeneous();
    const Eigen::Vector3d x2 =
        pair.view2.keypoints[match.keypoint_idx2].cast<double>().homogeneous();
    const Eigen::Vector3d line = *verified.F * x1;
    EXPECT_LT(std::abs(x2.dot(line)) / line.head<2>().norm(), 12.0);
  }
}

TEST(VerifyPair, PlaneIsPlanar) {
  Random random(2);
  const SimulatedPair pair =
      SimulatePair(Pinhole(), kMotion, {}, &random, DrawOnPlane);
  const ImagePair verified = Verify(pair);
  EXPECT_EQ(verified.config, TwoViewConfig::kPlanar);
  EXPECT_GE(CountTrue(verified, pair), pair.num_true - 2);
  ASSERT_TRUE(verified.H);
  for (size_t i = 0; i < pair.num_true; ++i) {
    const Eigen::Vector3d x2 =
        *verified.H * pair.view1.keypoints[i].cast<double>().homogeneous();
    const Eigen::Vector2d error =
        x2.hnormalized() - pair.view2.keypoints[i].cast<double>();
    EXPECT_LT(error.norm(), 5.0);
  }
}

TEST(VerifyPair, RotationIsPanoramic) {
  Random random(3);
  const Rigid3 rotation{kMotion.rotation, Eigen::Vector3d::Zero()};
  for (const double noise_px : {0.0, 0.5}) {
    const SimulatedPair pair = SimulatePair(
        Pinhole(), rotation, {150, 50, noise_px}, &random, DrawInBox);
    const ImagePair verified = Verify(pair);
    EXPECT_EQ(verified.config, TwoViewConfig::kPanoramic);
    EXPECT_GE(CountTrue(verified, pair), pair.num_true - 2);
    EXPECT_FALSE(verified.relative_pose->translation_direction);
    EXPECT_LT(RotationErrorDeg(verified, rotation), 0.1);
  }
}

TEST(VerifyPair, HandlesRaysBehindTheCamera) {
  Random random(4);
  const SimulatedPair pair =
      SimulatePair(Fisheye(), kMotion, {200, 100, 0.5}, &random, DrawAround);
  const auto num_behind =
      std::count_if(pair.view1.rays.begin(), pair.view1.rays.end(),
                    [](const auto& ray) { return ray && ray->z() < 0.0; });
  ASSERT_GT(num_behind, 10);
  const ImagePair verified = Verify(pair);
  EXPECT_EQ(verified.config, TwoViewConfig::kCalibrated);
  EXPECT_GE(CountTrue(verified, pair), pair.num_true - 3);
  EXPECT_LT(RotationErrorDeg(verified, kMotion), 0.3);
  EXPECT_LT(DirectionErrorDeg(verified, kMotion), 1.0);
  EXPECT_FALSE(verified.F);
}

TEST(VerifyPair, WithoutPriorFocalLengthUsesF) {
  Random random(5);
  SimulatedPair pair = SimulatePair(Pinhole(), kMotion, {}, &random, DrawInBox);
  // The focal length is a wrong guess.
  for (SimulatedView* view : {&pair.view1, &pair.view2}) {
    view->camera = MakeCamera(CameraModelId::kSimpleRadial, 800, 600,
                              {960, 400, 300, 0.0}, false);
  }
  const ImagePair verified = Verify(pair);
  EXPECT_EQ(verified.config, TwoViewConfig::kUncalibrated);
  EXPECT_GE(CountTrue(verified, pair), pair.num_true - 8);
  EXPECT_FALSE(verified.relative_pose);
  ASSERT_TRUE(verified.F);
  EXPECT_NEAR(verified.F->determinant(), 0.0, 1e-12);
  SimulatedPair planar =
      SimulatePair(Pinhole(), kMotion, {}, &random, DrawOnPlane);
  planar.view1.camera = planar.view2.camera = pair.view1.camera;
  EXPECT_EQ(Verify(planar).config, TwoViewConfig::kPlanarOrPanoramic);
}

TEST(VerifyPair, FalseMatchesAreDegenerate) {
  Random random(6);
  for (const size_t num_false : {10, 30, 60}) {
    const SimulatedPair pair = SimulatePair(
        Pinhole(), kMotion, {0, num_false, 0.5}, &random, DrawInBox);
    const ImagePair verified = Verify(pair);
    EXPECT_EQ(verified.config, TwoViewConfig::kDegenerate);
    EXPECT_TRUE(verified.matches.empty());
  }
}

TEST(VerifyPair, RespectsInlierLimits) {
  Random random(7);
  const SimulatedPair pair =
      SimulatePair(Pinhole(), kMotion, {40, 60, 0.5}, &random, DrawInBox);
  EXPECT_EQ(Verify(pair).config, TwoViewConfig::kCalibrated);
  TwoViewGeometryOptions options;
  options.min_num_inliers = 60;
  EXPECT_EQ(Verify(pair, options).config, TwoViewConfig::kDegenerate);
  options = {};
  options.min_inlier_ratio = 0.6;
  EXPECT_EQ(Verify(pair, options).config, TwoViewConfig::kDegenerate);
}

TEST(VerifyPair, SwappedImagesGiveInverse) {
  Random random(8);
  const SimulatedPair pair =
      SimulatePair(Pinhole(), kMotion, {}, &random, DrawInBox);
  SimulatedPair swapped = pair;
  std::swap(swapped.view1, swapped.view2);
  const ImagePair verified = Verify(swapped);
  const Rigid3 inverse = kMotion.Inverse();
  EXPECT_LT(RotationErrorDeg(verified, inverse), 0.2);
  EXPECT_LT(DirectionErrorDeg(verified, inverse), 2.0);
}

TEST(VerifyPair, ShiftedBorderIsWatermark) {
  Random random(9);
  SimulatedPair pair;
  pair.view1.camera = pair.view2.camera = Pinhole();
  for (uint32_t i = 0; i < 60; ++i) {
    const Eigen::Vector2d pixel(random.Uniform(20.0, 780.0),
                                random.Uniform(520.0, 590.0));
    pair.view1.keypoints.emplace_back(pixel.cast<float>());
    pair.view2.keypoints.emplace_back(
        (pixel + Eigen::Vector2d(3.0, 1.0)).cast<float>());
    pair.matches.push_back({i, i});
  }
  pair.view1.rays = RaysOf(pair.view1.camera, pair.view1.keypoints);
  pair.view2.rays = RaysOf(pair.view2.camera, pair.view2.keypoints);
  EXPECT_EQ(Verify(pair).config, TwoViewConfig::kWatermark);
  TwoViewGeometryOptions options;
  options.detect_watermark = false;
  EXPECT_NE(Verify(pair, options).config, TwoViewConfig::kWatermark);
}

TEST(VerifyPair, SkipsKeypointsWithoutRay) {
  Random random(10);
  SimulatedPair pair = SimulatePair(Pinhole(), kMotion, {}, &random, DrawInBox);
  for (size_t i = 0; i < 20; ++i) pair.view1.rays[i].reset();
  const ImagePair verified = Verify(pair);
  EXPECT_EQ(verified.config, TwoViewConfig::kCalibrated);
  for (const Match& match : verified.matches) {
    EXPECT_GE(match.keypoint_idx1, 20u);
  }
}

TEST(PairSeed, DependsOnBothNamesAndSeed) {
  const std::set<uint64_t> seeds = {
      PairSeed("a", "b", 0), PairSeed("b", "a", 0), PairSeed("ab", "", 0),
      PairSeed("a", "b", 1)};
  EXPECT_EQ(seeds.size(), 4u);
}

RayMatches ExactRays(Random* random, const Rigid3& motion, size_t size,
                     Eigen::Vector3d (*draw_point)(Random*)) {
  RayMatches rays;
  for (size_t i = 0; i < size; ++i) {
    const Eigen::Vector3d point = draw_point(random);
    rays.Add(point.normalized(), (motion * point).normalized());
  }
  return rays;
}

TEST(RayModels, MinimalSamplesGiveExactModels) {
  Random random(11);
  const RansacOptions options;
  const RayMatches general = ExactRays(&random, kMotion, 9, DrawInBox);
  const auto F = EstimateFundamental(general, options, &random);
  ASSERT_TRUE(F);
  const Eigen::Matrix3d E = EssentialFromPose(kMotion).normalized();
  EXPECT_LT(std::min((*F - E).norm(), (*F + E).norm()), 1e-6);

  const RayMatches planar = ExactRays(&random, kMotion, 6, DrawOnPlane);
  const auto H = EstimateHomography(planar, options, &random);
  ASSERT_TRUE(H);
  const HomographyTest test(*H);
  for (size_t i = 0; i < planar.size(); ++i) {
    EXPECT_LT(test.SquaredError(planar.rays1[i], planar.rays2[i]), 1e-18);
  }
}

TEST(RayModels, HomographyHasPositiveScale) {
  Random random(12);
  RayMatches rays = ExactRays(&random, kMotion, 20, DrawOnPlane);
  for (size_t i = 0; i < 5; ++i) rays.rays2[i] = -rays.rays2[i];
  const auto H = EstimateHomography(rays, {}, &random);
  ASSERT_TRUE(H);
  const HomographyTest test(*H);
  for (size_t i = 0; i < rays.size(); ++i) {
    const double error = test.SquaredError(rays.rays1[i], rays.rays2[i]);
    EXPECT_EQ(error < 1e-12, i >= 5) << i;
  }
}

}  // namespace
}  // namespace mgsfm

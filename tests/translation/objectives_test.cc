// SPDX-License-Identifier: BSD-3-Clause
// The inputs and objectives of translation averaging that are there to compare
// with.
#include <gtest/gtest.h>

#include <algorithm>
#include <limits>
#include <tuple>

#include "mgsfm/base/error.h"
#include "translation/bilinear_refinement.h"
#include "translation/random_start.h"
#include "translation/translation_test_utils.h"

namespace mgsfm {
namespace {

using Eigen::Vector3d;

SimulationOptions Drive(RigPreset rig) {
  SimulationOptions options;
  options.rig = rig;
  options.path = PathPreset::kCurve;
  options.num_frames = 12;
  options.num_points_per_frame = 150;
  options.max_num_features_per_image = 250;
  return options;
}

TranslationAveragingOptions Options(TranslationSource input,
                                    TranslationObjective objective) {
  TranslationAveragingOptions options;
  options.input = input;
  options.objective = objective;
  return options;
}

class ObjectivesTest
    : public testing::TestWithParam<
          std::tuple<TranslationSource, TranslationObjective>> {};

TEST_P(ObjectivesTest, RecoversTheTruth) {
  const auto [source, objective] = GetParam();
  for (const RigPreset rig : {RigPreset::kStereo, RigPreset::kKitti360}) {
    const TranslationInput input = MakeTranslationInput(Drive(rig));
    const TranslationResult result = input.Run(Options(source, objective));
    EXPECT_TRUE(result.summary.initialization.IsUsable());
    EXPECT_TRUE(result.summary.camera_refinement.IsUsable());
    EXPECT_TRUE(result.summary.joint_refinement.IsUsable());
    EXPECT_EQ(result.summary.num_frames_not_placed, 0);
    EXPECT_GT(result.summary.num_points, 0.7 * input.tracks.size());
    EXPECT_LT(MeasureCenters(input, result.estimate).max_relative, 0.01);
  }
}

INSTANTIATE_TEST_SUITE_P(
    Ablation, ObjectivesTest,
    testing::Combine(testing::Values(TranslationSource::kRelativeTranslations,
                                     TranslationSource::kTracks,
                                     TranslationSource::kHybrid),
                     testing::Values(TranslationObjective::kBilinear,
                                     TranslationObjective::kNonBilinear)));

INSTANTIATE_TEST_SUITE_P(
    DistancesAlone, ObjectivesTest,
    testing::Values(std::tuple(TranslationSource::kRelativeTranslations,
                               TranslationObjective::kDistance)));

TEST(ObjectivesTest, AutoIsHybridAndNonBilinear) {
  SimulationOptions drive = Drive(RigPreset::kStereo);
  drive.pixel_noise_px = 0.5;
  const TranslationInput input = MakeTranslationInput(drive);
  const TranslationResult by_default = input.Run();
  const TranslationResult named = input.Run(
      Options(TranslationSource::kHybrid, TranslationObjective::kNonBilinear));
  EXPECT_EQ(by_default.estimate.frame_center_in_world,
            named.estimate.frame_center_in_world);
}

TEST(ObjectivesTest, EachComboIsItsOwn) {
  SimulationOptions drive = Drive(RigPreset::kStereo);
  drive.pixel_noise_px = 0.5;
  const TranslationInput input = MakeTranslationInput(drive);
  std::vector<Vector3d> centers;
  for (const auto source :
       {TranslationSource::kRelativeTranslations, TranslationSource::kTracks,
        TranslationSource::kHybrid}) {
    for (const auto objective : {TranslationObjective::kBilinear,
                                 TranslationObjective::kNonBilinear}) {
      const auto result = input.Run(Options(source, objective));
      EXPECT_LT(MeasureCenters(input, result.estimate).max_relative, 0.05);
      centers.push_back(*result.estimate.frame_center_in_world[5]);
    }
  }
  for (size_t i = 0; i < centers.size(); ++i) {
    for (size_t k = 0; k < i; ++k) EXPECT_NE(centers[i], centers[k]);
  }
}

TEST(ObjectivesTest, ThreadsDoNotMatter) {
  SimulationOptions drive = Drive(RigPreset::kStereo);
  drive.pixel_noise_px = 0.5;
  const TranslationInput input = MakeTranslationInput(drive);
  for (const auto source :
       {TranslationSource::kRelativeTranslations, TranslationSource::kTracks,
        TranslationSource::kHybrid}) {
    const auto options = Options(source, TranslationObjective::kBilinear);
    EXPECT_EQ(input.Run(options, 1).estimate.frame_center_in_world,
              input.Run(options, 3).estimate.frame_center_in_world);
  }
}

TEST(ObjectivesTest, GivenExtrinsicsMakeTracksMetric) {
  SimulationOptions drive = Drive(RigPreset::kStereo);
  drive.extrinsics_are_known = true;
  const TranslationInput input = MakeTranslationInput(drive);
  for (const auto objective :
       {TranslationObjective::kBilinear, TranslationObjective::kNonBilinear}) {
    const TranslationResult result =
        input.Run(Options(TranslationSource::kTracks, objective));
    EXPECT_TRUE(result.summary.is_metric);
    EXPECT_NEAR(MeasureCenters(input, result.estimate).scale, 1.0, 0.02);
  }
}

TEST(ObjectivesTest, DistancesNeedRelativeTranslations) {
  for (const auto source :
       {TranslationSource::kTracks, TranslationSource::kHybrid}) {
    EXPECT_THROW(CheckTranslationOptions(
                     Options(source, TranslationObjective::kDistance)),
                 Error);
  }
  EXPECT_NO_THROW(CheckTranslationOptions(
      Options(TranslationSource::kAuto, TranslationObjective::kDistance)));
}

TEST(BilinearResidualTest, DerivativesAreThoseOfDifferences) {
  Random random(3);
  const auto vector = [&] {
    return Vector3d(random.Normal(), random.Normal(), random.Normal());
  };
  constexpr double kStep = 1e-6;
  for (int trial = 0; trial < 20; ++trial) {
    const Vector3d direction = vector().normalized();
    const Vector3d difference = vector();
    const double scale = random.Uniform(0.1, 3.0);
    const double weight = random.Uniform(0.1, 2.0);
    const BilinearResidual at =
        EvaluateBilinear(direction, difference, scale, weight);
    for (int i = 0; i < 3; ++i) {
      const Vector3d step = kStep * Vector3d::Unit(i);
      const Vector3d by_difference =
          (EvaluateBilinear(direction, difference + step, scale, weight).value -
           EvaluateBilinear(direction, difference - step, scale, weight)
               .value) /
          (2.0 * kStep);
      EXPECT_LT((by_difference - at.by_difference * Vector3d::Unit(i)).norm(),
                1e-8);
    }
    const Vector3d by_scale =
        (EvaluateBilinear(direction, difference, scale + kStep, weight).value -
         EvaluateBilinear(direction, difference, scale - kStep, weight).value) /
        (2.0 * kStep);
    EXPECT_LT((by_scale - at.by_scale).norm(), 1e-8);
  }
}

// With the best scale the residual is the sine of the angle.
TEST(BilinearResidualTest, BestScaleGivesTheSine) {
  const Vector3d direction = Vector3d::UnitZ();
  const Vector3d difference(0.0, 3.0, 4.0);
  double least = std::numeric_limits<double>::infinity();
  for (double scale = 0.0; scale < 1.0; scale += 1e-4) {
    least = std::min(
        least,
        EvaluateBilinear(direction, difference, scale, 1.0).value.norm());
  }
  EXPECT_NEAR(least, 0.6, 1e-6);
}

}  // namespace
}  // namespace mgsfm

// SPDX-License-Identifier: BSD-3-Clause
// The inputs and objectives of translation averaging that are there to compare
// with.
#include <gtest/gtest.h>

#include <tuple>

#include "mgsfm/base/error.h"
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

}  // namespace
}  // namespace mgsfm

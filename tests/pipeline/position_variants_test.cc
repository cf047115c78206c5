// SPDX-License-Identifier: BSD-3-Clause
// The inputs and objectives of the paper's ablation.
#include "pipeline/position_variants.h"

#include <gtest/gtest.h>

#include <tuple>

#include "mgsfm/base/error.h"
#include "support/translation_input.h"

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

PositionResult Estimate(const TranslationInput& input,
                        const TranslationAveragingOptions& options,
                        int num_threads = 1) {
  Context context;
  context.num_threads = num_threads;
  return EstimatePositionsByVariant(
      {input.simulation.scene, input.bearings, input.simulation.view_graph,
       input.rotations, input.tracks},
      {options, PairFilteringOptions()}, context);
}

class PositionVariantsTest
    : public testing::TestWithParam<
          std::tuple<TranslationSource, TranslationObjective>> {};

TEST_P(PositionVariantsTest, RecoversTheTruth) {
  const auto [source, objective] = GetParam();
  for (const RigPreset rig : {RigPreset::kStereo, RigPreset::kKitti360}) {
    const TranslationInput input = MakeTranslationInput(Drive(rig));
    const PositionResult result = Estimate(input, Options(source, objective));
    EXPECT_TRUE(result.summary.initialization.IsUsable());
    EXPECT_TRUE(result.summary.camera_refinement.IsUsable());
    EXPECT_TRUE(result.summary.joint_refinement.IsUsable());
    EXPECT_EQ(result.summary.num_frames_not_placed, 0);
    EXPECT_GT(result.summary.num_points, 0.7 * input.tracks.size());
    EXPECT_LT(MeasureCenters(input, result.estimate).max_relative, 0.01);
  }
}

INSTANTIATE_TEST_SUITE_P(
    Ablation, PositionVariantsTest,
    testing::Combine(testing::Values(TranslationSource::kRelativeTranslations,
                                     TranslationSource::kTracks,
                                     TranslationSource::kHybrid),
                     testing::Values(TranslationObjective::kBilinear,
                                     TranslationObjective::kNonBilinear)));

INSTANTIATE_TEST_SUITE_P(
    DistancesAlone, PositionVariantsTest,
    testing::Values(std::tuple(TranslationSource::kRelativeTranslations,
                               TranslationObjective::kDistance)));

TEST(PositionVariantsTest, AutoIsHybridAndNonBilinear) {
  SimulationOptions drive = Drive(RigPreset::kStereo);
  drive.pixel_noise_px = 0.5;
  const TranslationInput input = MakeTranslationInput(drive);
  const PositionResult by_default =
      Estimate(input, TranslationAveragingOptions());
  const PositionResult named = Estimate(
      input,
      Options(TranslationSource::kHybrid, TranslationObjective::kNonBilinear));
  EXPECT_EQ(by_default.estimate.frame_center_in_world,
            named.estimate.frame_center_in_world);
  const PositionResult recipe = EstimatePositions(
      {input.simulation.scene, input.bearings, input.simulation.view_graph,
       input.rotations, input.tracks},
      PositionOptions(), Context());
  EXPECT_EQ(recipe.estimate.frame_center_in_world,
            named.estimate.frame_center_in_world);
}

TEST(PositionVariantsTest, EachComboIsItsOwn) {
  SimulationOptions drive = Drive(RigPreset::kStereo);
  drive.pixel_noise_px = 0.5;
  const TranslationInput input = MakeTranslationInput(drive);
  std::vector<Vector3d> centers;
  for (const auto source :
       {TranslationSource::kRelativeTranslations, TranslationSource::kTracks,
        TranslationSource::kHybrid}) {
    for (const auto objective : {TranslationObjective::kBilinear,
                                 TranslationObjective::kNonBilinear}) {
      const auto result = Estimate(input, Options(source, objective));
      EXPECT_LT(MeasureCenters(input, result.estimate).max_relative, 0.05);
      centers.push_back(*result.estimate.frame_center_in_world[5]);
    }
  }
  for (size_t i = 0; i < centers.size(); ++i) {
    for (size_t k = 0; k < i; ++k) EXPECT_NE(centers[i], centers[k]);
  }
}

TEST(PositionVariantsTest, ThreadsDoNotMatter) {
  SimulationOptions drive = Drive(RigPreset::kStereo);
  drive.pixel_noise_px = 0.5;
  const TranslationInput input = MakeTranslationInput(drive);
  for (const auto source :
       {TranslationSource::kRelativeTranslations, TranslationSource::kTracks,
        TranslationSource::kHybrid}) {
    const auto options = Options(source, TranslationObjective::kBilinear);
    EXPECT_EQ(Estimate(input, options, 1).estimate.frame_center_in_world,
              Estimate(input, options, 3).estimate.frame_center_in_world);
  }
}

TEST(PositionVariantsTest, GivenExtrinsicsMakeTracksMetric) {
  SimulationOptions drive = Drive(RigPreset::kStereo);
  drive.extrinsics_are_known = true;
  const TranslationInput input = MakeTranslationInput(drive);
  for (const auto objective :
       {TranslationObjective::kBilinear, TranslationObjective::kNonBilinear}) {
    const PositionResult result =
        Estimate(input, Options(TranslationSource::kTracks, objective));
    EXPECT_TRUE(result.summary.is_metric);
    EXPECT_NEAR(MeasureCenters(input, result.estimate).scale, 1.0, 0.02);
  }
}

TEST(PositionVariantsTest, DistancesNeedRelativeTranslations) {
  for (const auto source :
       {TranslationSource::kTracks, TranslationSource::kHybrid}) {
    EXPECT_THROW(CheckTranslationOptions(
                     Options(source, TranslationObjective::kDistance)),
                 Error);
  }
  EXPECT_NO_THROW(CheckTranslationOptions(
      Options(TranslationSource::kAuto, TranslationObjective::kDistance)));
}

// From a random start, where nothing is right at first.
TEST(PositionVariantsTest, RandomStartsLeadToTheSamePlace) {
  SimulationOptions drive = Drive(RigPreset::kStereo);
  drive.num_frames = 10;
  drive.num_points_per_frame = 60;
  drive.max_num_features_per_image = 120;
  const TranslationInput input = MakeTranslationInput(drive);
  TranslationAveragingOptions options =
      Options(TranslationSource::kTracks, TranslationObjective::kBilinear);
  for (const auto backend : {SolverBackend::kNative, SolverBackend::kCeres}) {
    options.backend = backend;
    EXPECT_LT(
        MeasureCenters(input, Estimate(input, options).estimate).max_relative,
        0.01);
  }
}

}  // namespace
}  // namespace mgsfm

// SPDX-License-Identifier: BSD-3-Clause
// The inputs and objectives of the paper's ablation.
#include "baselines/position_baselines.h"

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

PositionBaselineOptions Baseline(TranslationSource source,
                                 TranslationObjective objective) {
  PositionBaselineOptions options;
  options.input = source;
  options.objective = objective;
  return options;
}

PositionResult Estimate(const TranslationInput& input,
                        const PositionBaselineOptions& baseline,
                        int num_threads = 1,
                        const PositionOptions& options = {}) {
  Context context;
  context.num_threads = num_threads;
  const Scene& scene = input.simulation.scene;
  const ViewGraph& view_graph = input.simulation.view_graph;
  const FramePairIndex index(scene, view_graph);
  return EstimatePositionsByBaseline(
      baseline,
      {scene, input.bearings, view_graph, index, input.rotations, input.tracks},
      options, context);
}

class PositionBaselinesTest
    : public testing::TestWithParam<
          std::tuple<TranslationSource, TranslationObjective>> {};

TEST_P(PositionBaselinesTest, RecoversTheTruth) {
  const auto [source, objective] = GetParam();
  for (const RigPreset rig : {RigPreset::kStereo, RigPreset::kKitti360}) {
    const TranslationInput input = MakeTranslationInput(Drive(rig));
    const PositionResult result = Estimate(input, Baseline(source, objective));
    EXPECT_TRUE(result.summary.initialization.IsUsable());
    EXPECT_TRUE(result.summary.camera_refinement.IsUsable());
    EXPECT_TRUE(result.summary.joint_refinement.IsUsable());
    EXPECT_EQ(result.summary.num_frames_not_placed, 0);
    EXPECT_GT(result.summary.num_points, 0.7 * input.tracks.size());
    EXPECT_LT(MeasureCenters(input, result.estimate).max_relative, 0.01);
  }
}

INSTANTIATE_TEST_SUITE_P(
    Ablation, PositionBaselinesTest,
    testing::Combine(testing::Values(TranslationSource::kRelativeTranslations,
                                     TranslationSource::kTracks,
                                     TranslationSource::kHybrid),
                     testing::Values(TranslationObjective::kBilinear,
                                     TranslationObjective::kNonBilinear)));

INSTANTIATE_TEST_SUITE_P(
    DistancesAlone, PositionBaselinesTest,
    testing::Values(std::tuple(TranslationSource::kRelativeTranslations,
                               TranslationObjective::kDistance)));

TEST(PositionBaselinesTest, AutoIsHybridAndNonBilinear) {
  SimulationOptions drive = Drive(RigPreset::kStereo);
  drive.pixel_noise_px = 0.5;
  const TranslationInput input = MakeTranslationInput(drive);
  const PositionResult by_default = Estimate(input, PositionBaselineOptions());
  const PositionResult named = Estimate(
      input,
      Baseline(TranslationSource::kHybrid, TranslationObjective::kNonBilinear));
  EXPECT_EQ(by_default.estimate.frame_center_in_world,
            named.estimate.frame_center_in_world);
  const FramePairIndex index(input.simulation.scene,
                             input.simulation.view_graph);
  const PositionResult recipe = EstimatePositions(
      {input.simulation.scene, input.bearings, input.simulation.view_graph,
       index, input.rotations, input.tracks},
      PositionOptions(), Context());
  EXPECT_EQ(recipe.estimate.frame_center_in_world,
            named.estimate.frame_center_in_world);
}

TEST(PositionBaselinesTest, EachComboIsItsOwn) {
  SimulationOptions drive = Drive(RigPreset::kStereo);
  drive.pixel_noise_px = 0.5;
  const TranslationInput input = MakeTranslationInput(drive);
  std::vector<Vector3d> centers;
  for (const auto source :
       {TranslationSource::kRelativeTranslations, TranslationSource::kTracks,
        TranslationSource::kHybrid}) {
    for (const auto objective : {TranslationObjective::kBilinear,
                                 TranslationObjective::kNonBilinear}) {
      const auto result = Estimate(input, Baseline(source, objective));
      EXPECT_LT(MeasureCenters(input, result.estimate).max_relative, 0.05);
      centers.push_back(*result.estimate.frame_center_in_world[5]);
    }
  }
  for (size_t i = 0; i < centers.size(); ++i) {
    for (size_t k = 0; k < i; ++k) EXPECT_NE(centers[i], centers[k]);
  }
}

TEST(PositionBaselinesTest, ThreadsDoNotMatter) {
  SimulationOptions drive = Drive(RigPreset::kStereo);
  drive.pixel_noise_px = 0.5;
  const TranslationInput input = MakeTranslationInput(drive);
  for (const auto source :
       {TranslationSource::kRelativeTranslations, TranslationSource::kTracks,
        TranslationSource::kHybrid}) {
    const PositionBaselineOptions baseline =
        Baseline(source, TranslationObjective::kBilinear);
    EXPECT_EQ(Estimate(input, baseline, 1).estimate.frame_center_in_world,
              Estimate(input, baseline, 3).estimate.frame_center_in_world);
  }
}

TEST(PositionBaselinesTest, KnownExtrinsicsMakeTracksMetric) {
  SimulationOptions drive = Drive(RigPreset::kStereo);
  drive.extrinsics_are_known = true;
  const TranslationInput input = MakeTranslationInput(drive);
  for (const auto objective :
       {TranslationObjective::kBilinear, TranslationObjective::kNonBilinear}) {
    const PositionResult result =
        Estimate(input, Baseline(TranslationSource::kTracks, objective));
    EXPECT_TRUE(result.summary.is_metric);
    EXPECT_NEAR(MeasureCenters(input, result.estimate).scale, 1.0, 0.02);
  }
}

TEST(PositionBaselinesTest, DistancesNeedRelativeTranslations) {
  for (const auto source :
       {TranslationSource::kTracks, TranslationSource::kHybrid}) {
    EXPECT_THROW(CheckPositionBaseline(
                     Baseline(source, TranslationObjective::kDistance)),
                 Error);
  }
  EXPECT_NO_THROW(CheckPositionBaseline(
      Baseline(TranslationSource::kAuto, TranslationObjective::kDistance)));
}

// A random start has no information about positions.
TEST(PositionBaselinesTest, RandomStartsLeadToTheSamePlace) {
  SimulationOptions drive = Drive(RigPreset::kStereo);
  drive.num_frames = 10;
  drive.num_points_per_frame = 60;
  drive.max_num_features_per_image = 120;
  const TranslationInput input = MakeTranslationInput(drive);
  const PositionBaselineOptions baseline =
      Baseline(TranslationSource::kTracks, TranslationObjective::kBilinear);
  EXPECT_LT(
      MeasureCenters(input, Estimate(input, baseline).estimate).max_relative,
      0.01);
}

}  // namespace
}  // namespace mgsfm

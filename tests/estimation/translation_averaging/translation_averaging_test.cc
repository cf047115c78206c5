// SPDX-License-Identifier: BSD-3-Clause
#include "mgsfm/translation_averaging/translation_averaging.h"

#include <gtest/gtest.h>

#include <tuple>

#include "support/translation_input.h"

namespace mgsfm {
namespace {

TranslationResult Average(const TranslationInput& input, int num_threads = 1) {
  Context context;
  context.num_threads = num_threads;
  return AverageTranslations(
      {input.simulation.scene, input.bearings, input.simulation.view_graph,
       input.rotations, input.tracks},
      TranslationAveragingOptions(), context);
}

class ExactTest
    : public testing::TestWithParam<std::tuple<RigPreset, PathPreset>> {};

TEST_P(ExactTest, RecoversTheTruth) {
  const auto [rig, path] = GetParam();
  const TranslationInput input = MakeTranslationInput(SmallDrive(rig, path));
  const TranslationResult result = Average(input);
  ExpectTruth(input, result.estimate, result.summary);
}

INSTANTIATE_TEST_SUITE_P(
    Presets, ExactTest,
    testing::Combine(testing::Values(RigPreset::kMono, RigPreset::kKitti360),
                     testing::Values(PathPreset::kLoop,
                                     PathPreset::kStraight)));

TEST(TranslationAveragingTest, KnownExtrinsicsDetermineTheUnit) {
  SimulationOptions options =
      SmallDrive(RigPreset::kStereo, PathPreset::kCurve);
  options.extrinsics_are_known = true;
  const TranslationInput input = MakeTranslationInput(options);
  const TranslationResult result = Average(input);
  EXPECT_TRUE(result.summary.is_metric);
  EXPECT_NEAR(MeasureCenters(input, result.estimate).scale, 1.0, 1e-5);
}

// Relative poses without matches suffice where directions determine positions:
// in a loop, not on a straight line.
TEST(TranslationAveragingTest, DirectionsWithoutMatches) {
  TranslationInput input =
      MakeTranslationInput(SmallDrive(RigPreset::kMono, PathPreset::kLoop));
  const Scene& scene = input.simulation.scene;
  for (ImagePair& pair : input.simulation.view_graph.pairs) {
    const Reconstruction& truth = input.simulation.ground_truth;
    const Rigid3 cam2_from_cam1 =
        *truth.CamFromWorld(scene, pair.image_idx2) *
        truth.CamFromWorld(scene, pair.image_idx1)->Inverse();
    pair.relative_pose = RelativePose{cam2_from_cam1.rotation,
                                      cam2_from_cam1.translation.normalized()};
    pair.matches.clear();
  }
  input.tracks = {};
  const TranslationResult result = Average(input);
  EXPECT_EQ(result.summary.num_pairs_used,
            static_cast<int>(input.simulation.view_graph.pairs.size()));
  EXPECT_LT(MeasureCenters(input, result.estimate).max_relative, 1e-3);
}

// Pairs outside rotations.pair_is_inlier have no effect.
TEST(TranslationAveragingTest, UsesInliersOnly) {
  SimulationOptions options =
      SmallDrive(RigPreset::kStereo, PathPreset::kCurve);
  TranslationInput input = MakeTranslationInput(options);
  const TranslationResult all = Average(input);
  const ImagePair wrong = [&] {
    ImagePair pair = input.simulation.view_graph.pairs.front();
    pair.image_idx2 =
        static_cast<int>(input.simulation.scene.images.size()) - 1;
    return pair;
  }();
  input.simulation.view_graph.pairs.push_back(wrong);
  input.rotations.pair_is_inlier.push_back(false);
  const TranslationResult without = Average(input);
  EXPECT_EQ(all.estimate.frame_center_in_world,
            without.estimate.frame_center_in_world);
}

TEST(TranslationAveragingTest, ThreadsDoNotMatter) {
  SimulationOptions options =
      SmallDrive(RigPreset::kStereo, PathPreset::kCurve);
  options.pixel_noise_px = 0.5;
  const TranslationInput input = MakeTranslationInput(options);
  EXPECT_EQ(Average(input, 1).estimate.frame_center_in_world,
            Average(input, 3).estimate.frame_center_in_world);
}

}  // namespace
}  // namespace mgsfm

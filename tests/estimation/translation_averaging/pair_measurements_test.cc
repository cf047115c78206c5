// SPDX-License-Identifier: BSD-3-Clause
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>

#include "geometry/so3.h"
#include "math/statistics.h"
#include "support/translation_input.h"
#include "translation_averaging/baseline_directions.h"
#include "translation_averaging/position_problem.h"
#include "translation_averaging/scale_averaging.h"

namespace mgsfm {
namespace {

using Eigen::Vector3d;

std::vector<BaselineDirection> Estimate(const TranslationInput& input,
                                        int num_threads = 1) {
  Context context;
  context.num_threads = num_threads;
  const PositionProblem problem =
      MakePositionProblem(input.simulation.scene, input.rotations);
  return EstimateBaselineDirections(
      {input.simulation.scene, input.bearings, input.simulation.view_graph,
       input.rotations.pair_is_inlier, problem},
      0.3, context);
}

Vector3d TrueBaseline(const TranslationInput& input,
                      const BaselineDirection& baseline) {
  const Scene& scene = input.simulation.scene;
  const Reconstruction& truth = input.simulation.ground_truth;
  return truth.CamFromWorld(scene, baseline.image_idx2)->Center() -
         truth.CamFromWorld(scene, baseline.image_idx1)->Center();
}

SimulationOptions Curve() {
  SimulationOptions options;
  options.num_frames = 10;
  return options;
}

TEST(BaselineDirectionsTest, ExactRaysGiveTheDirection) {
  const TranslationInput input = MakeTranslationInput(Curve());
  int num_directions = 0;
  for (const BaselineDirection& baseline : Estimate(input)) {
    EXPECT_NE(baseline.kind, BaselineKind::kUnused);
    if (baseline.kind != BaselineKind::kDirection) continue;
    ++num_directions;
    EXPECT_LT(AngleBetween(baseline.direction, TrueBaseline(input, baseline)),
              1e-7);
  }
  EXPECT_GT(num_directions, 100);
}

TEST(BaselineDirectionsTest, NoiseAndMismatchesGiveHonestSigmas) {
  SimulationOptions options = Curve();
  options.pixel_noise_px = 0.7;
  options.mismatch_ratio = 0.15;
  const TranslationInput input = MakeTranslationInput(options);
  std::vector<double> errors, ratios;
  for (const BaselineDirection& baseline : Estimate(input)) {
    if (baseline.kind != BaselineKind::kDirection) continue;
    errors.push_back(
        AngleBetween(baseline.direction, TrueBaseline(input, baseline)));
    ratios.push_back(errors.back() / baseline.sigma_rad);
  }
  ASSERT_GT(errors.size(), 100u);
  EXPECT_LT(Median(errors), DegToRad(1.0));
  EXPECT_LT(Quantile(ratios, 0.9), 3.0);
}

TEST(BaselineDirectionsTest, StandingFramesHaveNoParallax) {
  SimulationOptions options = Curve();
  options.path = PathPreset::kStanding;
  options.pixel_noise_px = 0.5;
  TranslationInput input = MakeTranslationInput(options);
  for (ImagePair& pair : input.simulation.view_graph.pairs) {
    pair.relative_pose.reset();
  }
  int num_checked = 0;
  for (const BaselineDirection& baseline : Estimate(input)) {
    const bool is_same_place = TrueBaseline(input, baseline).norm() < 1e-9;
    EXPECT_EQ(baseline.kind, is_same_place ? BaselineKind::kNoParallax
                                           : BaselineKind::kDirection);
    ++num_checked;
  }
  EXPECT_GT(num_checked, 20);
}

TEST(BaselineDirectionsTest, WrongPairsAreNotUsed) {
  SimulationOptions options = Curve();
  options.wrong_pair_ratio = 1.0;
  const TranslationInput input = MakeTranslationInput(options);
  const std::vector<BaselineDirection> baselines = Estimate(input);
  const auto num_directions = std::count_if(
      baselines.begin(), baselines.end(), [](const BaselineDirection& m) {
        return m.kind == BaselineKind::kDirection;
      });
  EXPECT_LT(num_directions, 0.1 * baselines.size());
}

TEST(BaselineDirectionsTest, ThreadsDoNotMatter) {
  SimulationOptions options = Curve();
  options.pixel_noise_px = 0.5;
  const TranslationInput input = MakeTranslationInput(options);
  const auto one = Estimate(input, 1);
  const auto three = Estimate(input, 3);
  for (size_t i = 0; i < one.size(); ++i) {
    EXPECT_EQ(one[i].direction, three[i].direction);
  }
}

// All scales are the true lengths in one unit, which it returns.
double ExpectTrueLengths(const TranslationInput& input,
                         const std::vector<BaselineDirection>& baselines,
                         const PairScales& scales) {
  double unit = 0.0;
  for (size_t i = 0; i < baselines.size(); ++i) {
    if (!scales.pairs[i]) continue;
    const double ratio =
        TrueBaseline(input, baselines[i]).norm() / scales.pairs[i]->scale;
    if (unit == 0.0) unit = ratio;
    EXPECT_NEAR(ratio / unit, 1.0, 1e-6);
  }
  return unit;
}

TEST(ScaleAveragingTest, ExactDepthsGiveTheLengths) {
  for (const PathPreset path : {PathPreset::kCurve, PathPreset::kStraight}) {
    SimulationOptions options = Curve();
    options.path = path;
    options.rig = RigPreset::kMono;
    const TranslationInput input = MakeTranslationInput(options);
    const auto baselines = Estimate(input);
    const PairScales scales = AverageScales(
        baselines, static_cast<int>(input.simulation.scene.images.size()),
        Context());
    ASSERT_EQ(scales.group_sizes.size(), 1u);
    const double unit = ExpectTrueLengths(input, baselines, scales);
    EXPECT_GT(scales.typical_depth * unit, 2.0);
    EXPECT_LT(scales.typical_depth * unit, 30.0);
  }
}

TEST(ScaleAveragingTest, NoiseAndMismatchesAreBearable) {
  SimulationOptions options = Curve();
  options.pixel_noise_px = 0.7;
  options.mismatch_ratio = 0.1;
  options.wrong_pair_ratio = 0.1;
  const TranslationInput input = MakeTranslationInput(options);
  const auto baselines = Estimate(input);
  const PairScales scales = AverageScales(
      baselines, static_cast<int>(input.simulation.scene.images.size()),
      Context());
  std::vector<double> logs;
  for (size_t i = 0; i < baselines.size(); ++i) {
    if (!scales.pairs[i] || scales.pairs[i]->group != 0) continue;
    logs.push_back(std::log(TrueBaseline(input, baselines[i]).norm() /
                            scales.pairs[i]->scale));
  }
  ASSERT_GT(logs.size(), 80u);
  const double unit = Median(logs);
  for (double& value : logs) value = std::abs(value - unit);
  EXPECT_LT(Median(logs), 0.05);
}

// Without depths, nothing links a pair to the others. Expected lengths do, in
// whatever unit.
TEST(ScaleAveragingTest, ExpectedLengthsLinkPairsWithoutDepths) {
  const TranslationInput input = MakeTranslationInput(Curve());
  auto baselines = Estimate(input);
  LengthHints hints;
  hints.expected.resize(baselines.size());
  for (size_t i = 0; i < baselines.size(); ++i) {
    const double length = TrueBaseline(input, baselines[i]).norm();
    if (length > 0.0) hints.expected[i] = 7.0 * length;
    if (i % 5 > 0) continue;
    for (auto& depths : baselines[i].depths) depths.clear();
  }
  const auto num_images =
      static_cast<int>(input.simulation.scene.images.size());
  EXPECT_GT(AverageScales(baselines, num_images, Context()).group_sizes.size(),
            1u);
  const PairScales scales =
      AverageScales(baselines, num_images, Context(), hints);
  ASSERT_EQ(scales.group_sizes.size(), 1u);
  ExpectTrueLengths(input, baselines, scales);
}

TEST(ScaleAveragingTest, NoPairsAtAll) {
  const PairScales scales = AverageScales({}, 0, Context());
  EXPECT_TRUE(scales.group_sizes.empty());
  EXPECT_EQ(scales.typical_depth, 0.0);
}

}  // namespace
}  // namespace mgsfm

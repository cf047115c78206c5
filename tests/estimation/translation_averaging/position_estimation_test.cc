// SPDX-License-Identifier: BSD-3-Clause
#include "translation_averaging/position_estimation.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <cstdlib>
#include <limits>
#include <numeric>

#include "geometry/so3.h"
#include "support/translation_input.h"

namespace mgsfm {
namespace {

using Eigen::Vector3d;

PositionResult Estimate(const TranslationInput& input, int num_threads = 1) {
  Context context;
  context.num_threads = num_threads;
  const FramePairIndex index(input.simulation.scene,
                             input.simulation.view_graph);
  return EstimatePositions(
      {input.simulation.scene, input.bearings, input.simulation.view_graph,
       index, input.rotations, input.tracks},
      PositionOptions(), context);
}

bool AllFinite(const PositionEstimate& estimate) {
  const auto is_finite = [](const std::optional<Vector3d>& v) {
    return !v || v->allFinite();
  };
  return std::all_of(estimate.frame_center_in_world.begin(),
                     estimate.frame_center_in_world.end(), is_finite) &&
         std::all_of(estimate.sensor_from_rig_translation.begin(),
                     estimate.sensor_from_rig_translation.end(), is_finite) &&
         std::all_of(estimate.point_in_world.begin(),
                     estimate.point_in_world.end(), is_finite);
}

bool AllObservable(const PositionResult& result) {
  for (const auto& sensor : result.summary.sensors) {
    if (!sensor.is_observable) return false;
  }
  return true;
}

class ExactTest
    : public testing::TestWithParam<std::tuple<RigPreset, PathPreset>> {};

TEST_P(ExactTest, RecoversTheTruth) {
  const auto [rig, path] = GetParam();
  const TranslationInput input = MakeTranslationInput(SmallDrive(rig, path));
  const PositionResult result = Estimate(input);
  ExpectTruth(input, result.estimate, result.summary);
}

INSTANTIATE_TEST_SUITE_P(
    AllPresets, ExactTest,
    testing::Combine(testing::Values(RigPreset::kMono, RigPreset::kStereo,
                                     RigPreset::kKitti360, RigPreset::kCube6),
                     testing::Values(PathPreset::kLoop, PathPreset::kCurve,
                                     PathPreset::kStraight)));

TEST(PositionRecipeTest, StandingStereoIsOnePlaceWithABaseline) {
  for (const double noise_px : {0.0, 0.5}) {
    SimulationOptions options =
        SmallDrive(RigPreset::kStereo, PathPreset::kStanding);
    options.pixel_noise_px = noise_px;
    const TranslationInput input = MakeTranslationInput(options);
    const PositionResult result = Estimate(input);
    EXPECT_TRUE(AllObservable(result));
    const double tolerance = noise_px == 0.0 ? 1e-6 : 0.02;
    EXPECT_LT(MeasureCenters(input, result.estimate).max_relative, tolerance);
    EXPECT_GT(result.summary.num_pairs_without_parallax, 0);
    EXPECT_EQ(result.summary.num_frames_not_placed, 0);
  }
}

TEST(PositionRecipeTest, StandingSingleCameraIsOnePlace) {
  SimulationOptions options =
      SmallDrive(RigPreset::kMono, PathPreset::kStanding);
  options.pixel_noise_px = 0.5;
  const TranslationInput input = MakeTranslationInput(options);
  const PositionResult result = Estimate(input);
  EXPECT_TRUE(AllFinite(result.estimate));
  for (const auto& center : result.estimate.frame_center_in_world) {
    ASSERT_TRUE(center.has_value());
    EXPECT_LT(center->norm(), 1e-6);
  }
  EXPECT_EQ(result.summary.num_pairs_used, 0);
  EXPECT_EQ(result.summary.num_points, 0u);
}

TEST(PositionRecipeTest, StandingRigsWithLittleOverlapStayTogether) {
  for (const RigPreset rig : {RigPreset::kKitti360, RigPreset::kCube6}) {
    SimulationOptions options = SmallDrive(rig, PathPreset::kStanding);
    options.pixel_noise_px = 0.5;
    const TranslationInput input = MakeTranslationInput(options);
    const PositionResult result = Estimate(input);
    EXPECT_TRUE(AllFinite(result.estimate));
    EXPECT_EQ(result.summary.num_frames_not_placed, 0);
    const auto& centers = result.estimate.frame_center_in_world;
    const double baseline =
        result.estimate.sensor_from_rig_translation[1]->norm();
    for (const auto& center : centers) {
      EXPECT_LT(center->norm(), 0.1 * baseline);
    }
  }
}

TEST(PositionRecipeTest, NoiseMismatchesAndWrongPairsAreBearable) {
  for (const PathPreset path :
       {PathPreset::kLoop, PathPreset::kCurve, PathPreset::kStraight}) {
    for (const RigPreset rig : {RigPreset::kStereo, RigPreset::kKitti360}) {
      SimulationOptions options = SmallDrive(rig, path);
      options.pixel_noise_px = 0.5;
      options.mismatch_ratio = 0.1;
      options.wrong_pair_ratio = 0.1;
      TranslationInput input = MakeTranslationInput(options);
      Random random(1);
      for (Observation& o : input.tracks.observations) {
        if (random.Uniform() > 0.05) continue;
        const auto& rays = input.bearings.images[o.image_idx];
        o.keypoint_idx =
            static_cast<int>(random.Index(static_cast<uint32_t>(rays.size())));
      }
      const PositionResult result = Estimate(input);
      EXPECT_LT(MeasureCenters(input, result.estimate).max_relative, 0.02);
    }
  }
}

TEST(PositionRecipeTest, KnownExtrinsicsMakeItMetric) {
  for (const RigPreset rig : {RigPreset::kStereo, RigPreset::kKitti360}) {
    SimulationOptions options = SmallDrive(rig, PathPreset::kCurve);
    options.extrinsics_are_known = true;
    const TranslationInput input = MakeTranslationInput(options);
    const PositionResult result = Estimate(input);
    EXPECT_TRUE(result.summary.is_metric);
    const CenterError error = MeasureCenters(input, result.estimate);
    EXPECT_LT(error.max_relative, 1e-6);
    EXPECT_NEAR(error.scale, 1.0, 1e-5);
    EXPECT_EQ(*result.estimate.sensor_from_rig_translation[1],
              input.simulation.scene.sensors[1].sensor_from_rig->translation);
  }
}

// Only the rig connects different sensors.
TranslationInput MakeInputWithoutOverlap(SimulationOptions options) {
  options.match_different_sensors = false;
  TranslationInput input = MakeTranslationInput(options);
  ObservationGroups tracks;
  const auto& images = input.simulation.scene.images;
  for (size_t t = 0; t < input.tracks.size(); ++t) {
    for (int sensor = 0; sensor < 4; ++sensor) {
      for (const Observation* o = input.tracks.begin(t);
           o != input.tracks.end(t); ++o) {
        if (images[o->image_idx].sensor_idx == sensor) {
          tracks.observations.push_back(*o);
        }
      }
      tracks.FinishGroup();
    }
  }
  input.tracks = tracks;
  return input;
}

TEST(PositionRecipeTest, StraightPathWithoutOverlapIsReported) {
  SimulationOptions options =
      SmallDrive(RigPreset::kKitti360, PathPreset::kStraight);
  for (const bool is_known : {false, true}) {
    options.extrinsics_are_known = is_known;
    const TranslationInput input = MakeInputWithoutOverlap(options);
    const PositionResult result = Estimate(input);
    EXPECT_LT(MeasureCenters(input, result.estimate, true).max_relative, 1e-6);
    EXPECT_FALSE(result.summary.is_metric);
    for (size_t s = 1; s < result.summary.sensors.size(); ++s) {
      const auto& sensor = result.summary.sensors[s];
      EXPECT_FALSE(sensor.message.empty());
      EXPECT_EQ(sensor.is_observable, is_known);
      if (is_known) continue;
      EXPECT_EQ(sensor.num_unobservable_directions, 3);
      EXPECT_LT(result.estimate.sensor_from_rig_translation[s]->norm(), 1e-6);
    }
  }
}

// Turning about the vertical only does not tell heights, and a circle of a
// camera beside the center of the rig is like one of another radius.
TEST(PositionRecipeTest, LevelCircleWithoutOverlapIsReported) {
  const TranslationInput input = MakeInputWithoutOverlap(
      SmallDrive(RigPreset::kKitti360, PathPreset::kLoop));
  const PositionResult result = Estimate(input);
  EXPECT_LT(MeasureCenters(input, result.estimate, true).max_relative, 1e-6);
  for (size_t s = 1; s < result.summary.sensors.size(); ++s) {
    EXPECT_EQ(result.summary.sensors[s].num_unobservable_directions, 2);
  }
}

TEST(PositionRecipeTest, WindingRoadWithoutOverlapIsRecovered) {
  SimulationOptions options =
      SmallDrive(RigPreset::kKitti360, PathPreset::kCurve);
  options.num_frames = 60;
  options.num_matched_frames = 6;
  const TranslationInput input = MakeInputWithoutOverlap(options);
  const PositionResult result = Estimate(input);
  const CenterError error = MeasureCenters(input, result.estimate, true);
  EXPECT_LT(error.max_relative, 1e-6);
  for (size_t s = 1; s < result.summary.sensors.size(); ++s) {
    const Vector3d difference =
        error.scale * *result.estimate.sensor_from_rig_translation[s] -
        input.simulation.ground_truth.sensor_from_rig[s]->translation;
    EXPECT_LT(difference.norm(), 1e-4);
  }
}

TEST(PositionRecipeTest, MissingImagesAndRotations) {
  SimulationOptions options =
      SmallDrive(RigPreset::kStereo, PathPreset::kCurve);
  options.missing_image_ratio = 0.2;
  TranslationInput input = MakeTranslationInput(options);
  input.rotations.rig_from_world.back().reset();
  const PositionResult result = Estimate(input);
  const auto& centers = result.estimate.frame_center_in_world;
  EXPECT_FALSE(centers.back().has_value());
  EXPECT_EQ(std::count_if(centers.begin(), centers.end(),
                          [](const auto& c) { return c.has_value(); }),
            static_cast<int>(centers.size()) - 1);
}

TEST(PositionRecipeTest, FrameWithoutUsablePairsIsPlacedByPoints) {
  TranslationInput input =
      MakeTranslationInput(SmallDrive(RigPreset::kStereo, PathPreset::kCurve));
  for (size_t p = 0; p < input.simulation.view_graph.pairs.size(); ++p) {
    const ImagePair& pair = input.simulation.view_graph.pairs[p];
    for (const int i : {pair.image_idx1, pair.image_idx2}) {
      if (input.simulation.scene.images[i].frame_idx == 5) {
        input.rotations.pair_is_inlier[p] = false;
      }
    }
  }
  const PositionResult result = Estimate(input);
  EXPECT_EQ(result.summary.num_frames_placed_by_points, 1);
  EXPECT_LT(MeasureCenters(input, result.estimate).max_relative, 1e-6);
}

TEST(PositionRecipeTest, NothingToEstimate) {
  TranslationInput input =
      MakeTranslationInput(SmallDrive(RigPreset::kStereo, PathPreset::kCurve));
  for (auto& rotation : input.rotations.rig_from_world) rotation.reset();
  const PositionResult result = Estimate(input);
  EXPECT_TRUE(AllFinite(result.estimate));
  for (const auto& center : result.estimate.frame_center_in_world) {
    EXPECT_FALSE(center.has_value());
  }
}

TEST(PositionRecipeTest, ThreadsDoNotMatter) {
  SimulationOptions options =
      SmallDrive(RigPreset::kKitti360, PathPreset::kCurve);
  options.pixel_noise_px = 0.5;
  options.mismatch_ratio = 0.1;
  const TranslationInput input = MakeTranslationInput(options);
  const PositionResult one = Estimate(input, 1);
  const PositionResult two = Estimate(input, 2);
  for (size_t f = 0; f < one.estimate.frame_center_in_world.size(); ++f) {
    EXPECT_LT((*one.estimate.frame_center_in_world[f] -
               *two.estimate.frame_center_in_world[f])
                  .norm(),
              1e-9);
  }
}

TEST(PositionRecipeTest, OrderOfTracksAndMatchesDoesNotMatter) {
  SimulationOptions options =
      SmallDrive(RigPreset::kStereo, PathPreset::kCurve);
  options.pixel_noise_px = 0.5;
  const TranslationInput input = MakeTranslationInput(options);
  TranslationInput reversed = input;
  for (ImagePair& pair : reversed.simulation.view_graph.pairs) {
    std::reverse(pair.matches.begin(), pair.matches.end());
  }
  reversed.tracks = ObservationGroups();
  for (size_t t = input.tracks.size(); t-- > 0;) {
    reversed.tracks.observations.insert(reversed.tracks.observations.end(),
                                        input.tracks.begin(t),
                                        input.tracks.end(t));
    reversed.tracks.FinishGroup();
  }
  const CenterError a = MeasureCenters(input, Estimate(input).estimate);
  const CenterError b = MeasureCenters(reversed, Estimate(reversed).estimate);
  EXPECT_NEAR(a.max_relative, b.max_relative, 2e-3);
}

// A closed drive with a step that few pairs and tracks cross.
TranslationInput LoopWithAThinStep(int thin_step) {
  constexpr size_t kMaxNumTracksAcross = 20;
  SimulationOptions options = SmallDrive(RigPreset::kStereo, PathPreset::kLoop);
  options.num_frames = 60;
  TranslationInput input = MakeTranslationInput(options);
  const Scene& scene = input.simulation.scene;
  const auto is_before = [&](int image_idx) {
    return scene.images[image_idx].frame_idx < thin_step;
  };
  const ViewGraph& view_graph = input.simulation.view_graph;
  for (size_t i = 0; i < view_graph.pairs.size(); ++i) {
    const ImagePair& pair = view_graph.pairs[i];
    const int gap = scene.images[pair.image_idx2].frame_idx -
                    scene.images[pair.image_idx1].frame_idx;
    if (is_before(pair.image_idx1) != is_before(pair.image_idx2) &&
        std::abs(gap) < options.num_frames / 2) {
      input.rotations.pair_is_inlier[i] = std::abs(gap) == 1;
    }
  }
  ObservationGroups tracks;
  size_t num_across = 0;
  for (size_t t = 0; t < input.tracks.size(); ++t) {
    const bool first_is_before = is_before(input.tracks.begin(t)->image_idx);
    ObservationGroups rest;
    for (const auto* o = input.tracks.begin(t); o != input.tracks.end(t); ++o) {
      (is_before(o->image_idx) == first_is_before ||
               num_across < kMaxNumTracksAcross
           ? tracks
           : rest)
          .observations.push_back(*o);
    }
    num_across +=
        is_before(tracks.observations.back().image_idx) != first_is_before;
    tracks.FinishGroup();
    if (rest.observations.empty()) continue;
    tracks.observations.insert(tracks.observations.end(),
                               rest.observations.begin(),
                               rest.observations.end());
    tracks.FinishGroup();
  }
  input.tracks = std::move(tracks);
  return input;
}

// Rotations that drift leave a gap in a loop. Positions alone would close it at
// the step that the fewest pairs cross.
TEST(PositionRecipeTest, RotationsThatDriftDoNotDisplaceTheWeakestStep) {
  constexpr int kThinStep = 20;
  constexpr double kDriftPerFrame_rad = DegToRad(0.1);
  TranslationInput input = LoopWithAThinStep(kThinStep);
  for (size_t f = 0; f < input.rotations.rig_from_world.size(); ++f) {
    auto& rotation = input.rotations.rig_from_world[f];
    const double drift = static_cast<double>(f) * kDriftPerFrame_rad;
    rotation = ExpSO3({drift, 0.0, 0.0}) * *rotation;
  }
  const FramePairIndex index(input.simulation.scene,
                             input.simulation.view_graph, SequenceMode::kYes);
  const PositionResult result = EstimatePositions(
      {input.simulation.scene, input.bearings, input.simulation.view_graph,
       index, input.rotations, input.tracks},
      PositionOptions(), Context());
  EXPECT_EQ(result.summary.num_displaced_steps, 0);
  EXPECT_LT(MeasureCenters(input, result.estimate, true).max_relative, 0.01);
  ASSERT_TRUE(result.corrected_rig_from_world);
  const auto& corrected = *result.corrected_rig_from_world;
  const auto& truth = input.simulation.ground_truth.rig_from_world;
  const Eigen::Quaterniond aligned =
      corrected[0]->inverse() * truth[0]->rotation;
  for (size_t f = 0; f < corrected.size(); ++f) {
    EXPECT_LT((*corrected[f] * aligned).angularDistance(truth[f]->rotation),
              0.1 * kDriftPerFrame_rad * static_cast<double>(truth.size()));
  }
}

}  // namespace
}  // namespace mgsfm

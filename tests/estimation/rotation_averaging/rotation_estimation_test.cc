// SPDX-License-Identifier: BSD-3-Clause
#include "rotation_averaging/rotation_estimation.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <cstdlib>

#include "estimation/rotation_averaging/rotation_test_utils.h"
#include "geometry/so3.h"
#include "mgsfm/simulator/simulation.h"

namespace mgsfm {
namespace {

using Eigen::Quaterniond;

EstimatedRotations Estimate(const Scene& scene, const ViewGraph& view_graph,
                            const PairFilteringOptions& filtering = {}) {
  return EstimateRotations(
      {scene, view_graph,
       FramePairIndex(scene, view_graph, filtering.is_sequence)},
      {RotationAveragingOptions(), filtering}, Context());
}

EstimatedRotations Estimate(const Simulation& simulation,
                            const PairFilteringOptions& filtering = {}) {
  return Estimate(simulation.scene, simulation.view_graph, filtering);
}

constexpr int kDriveLength = 60;

// Few correct pairs hold the trajectory together in the middle; more pairs of a
// duplicate structure would rotate it there.
Simulation DriveWithDuplicates(double turn_deg,
                               int num_frames_with_duplicates) {
  constexpr int kCut = kDriveLength / 2;
  SimulationOptions options = SmallSimulation();
  options.rig = RigPreset::kMono;
  options.num_frames = kDriveLength;
  options.num_matched_frames = 7;
  options.relative_rotation_noise_deg = 0.1;
  Simulation simulation = Simulate(options);
  const auto& truth = simulation.ground_truth.rig_from_world;
  auto& pairs = simulation.view_graph.pairs;
  KeepPairs(&simulation, [](const Image& image1, const Image& image2) {
    const auto [low, high] = std::minmax(image1.frame_idx, image2.frame_idx);
    return high - low <= (low < kCut && high >= kCut ? 2 : 7);
  });
  for (ImagePair& pair : pairs) {
    const int gap =
        std::abs(simulation.scene.images[pair.image_idx1].frame_idx -
                 simulation.scene.images[pair.image_idx2].frame_idx);
    pair.matches.resize(120 / gap);
  }
  const Quaterniond turn = ExpSO3({0.0, DegToRad(turn_deg), 0.0});
  for (int i = 10; i < 10 + num_frames_with_duplicates; ++i) {
    for (int k = i + 34; k <= i + 36; ++k) {
      ImagePair copy = pairs.front();
      copy.image_idx1 = simulation.scene.frames[i].image_idxs.front();
      copy.image_idx2 = simulation.scene.frames[k].image_idxs.front();
      copy.relative_pose->cam2_from_cam1 =
          turn * truth[k]->rotation * truth[i]->rotation.conjugate();
      copy.matches.resize(50);
      pairs.push_back(copy);
    }
  }
  return simulation;
}

TEST(RotationRecipe, DuplicatesSomeDegreesOffDoNotBreakTheTrajectory) {
  const Simulation simulation = DriveWithDuplicates(8.0, 6);
  const EstimatedRotations result = Estimate(simulation);
  EXPECT_EQ(NumFramesWithRotation(result.estimate), kDriveLength);
  EXPECT_LT(MaxFrameErrorDeg(simulation, result.estimate), 1.0);
}

// If images are missing, a frame can have more matches with an unrelated place
// than with its neighbors, and few pairs hold the trajectory together.
TEST(RotationRecipe, IsolatedWrongPairsDoNotBreakTheTrajectory) {
  for (const uint64_t seed : {1, 2, 3, 4, 5, 6, 7, 8, 9, 10}) {
    SimulationOptions options = StreetSimulation(RigPreset::kKitti360);
    options.num_frames = 30;
    options.relative_rotation_noise_deg = 0.1;
    options.missing_image_ratio = 0.6;
    options.isolated_wrong_pair_ratio = 0.1;
    options.random_seed = seed;
    const Simulation simulation = Simulate(options);
    const EstimatedRotations result = Estimate(simulation);
    EXPECT_EQ(result.summary.num_components, 1);
    EXPECT_LT(MaxFrameErrorDeg(simulation, result.estimate), 1.0) << seed;
  }
}

// Two pairs connect the halves, and they contradict each other.
TEST(RotationRecipe, UnsupportedBridgesDoNotConnectComponents) {
  constexpr int kNumFrames = 24, kCut = 12;
  SimulationOptions options = SmallSimulation();
  options.rig = RigPreset::kMono;
  options.num_frames = kNumFrames;
  Simulation simulation = Simulate(options);
  KeepPairs(&simulation, [](const Image& image1, const Image& image2) {
    const auto [low, high] = std::minmax(image1.frame_idx, image2.frame_idx);
    return (low < kCut) == (high < kCut) || high - low == 1;
  });
  EXPECT_EQ(Estimate(simulation).summary.num_components, 1);
  auto& pairs = simulation.view_graph.pairs;
  ImagePair wrong = pairs.front();
  wrong.image_idx1 = 3;
  wrong.image_idx2 = 20;
  wrong.relative_pose->cam2_from_cam1 = ExpSO3({0.0, DegToRad(-40.0), 0.0});
  for (uint32_t k = 0; k < wrong.matches.size(); ++k) {
    wrong.matches[k] = {1000 + k, 1000 + k};  // keypoints without other matches
  }
  pairs.push_back(wrong);
  PairFilteringOptions unordered;
  unordered.is_sequence = SequenceMode::kNo;
  const EstimatedRotations result = Estimate(simulation, unordered);
  EXPECT_EQ(NumFramesWithRotation(result.estimate), kNumFrames);
  EXPECT_EQ(result.summary.num_components, 2);
  EXPECT_EQ(result.summary.num_unsupported_bridges, 1);
  EXPECT_LT(MaxFrameErrorDeg(simulation, result.estimate, 0), 1e-6);
  EXPECT_LT(MaxFrameErrorDeg(simulation, result.estimate, 1), 1e-6);
  // In a sequence, neighbors connect the halves.
  const EstimatedRotations of_sequence = Estimate(simulation);
  EXPECT_EQ(of_sequence.summary.num_components, 1);
  EXPECT_LT(MaxFrameErrorDeg(simulation, of_sequence.estimate), 1e-6);
}

TEST(RotationRecipe, EveryPairIsAnInlierOrRejectedWithAReason) {
  SimulationOptions options = SmallSimulation();
  options.rig = RigPreset::kKitti360;
  options.relative_rotation_noise_deg = 0.2;
  options.wrong_pair_ratio = 0.2;
  Simulation simulation = Simulate(options);
  auto& pairs = simulation.view_graph.pairs;
  for (size_t i = 0; i < pairs.size(); i += 7) pairs[i].relative_pose.reset();
  const EstimatedRotations result = Estimate(simulation);
  for (size_t i = 0; i < pairs.size(); ++i) {
    EXPECT_EQ(result.estimate.pair_is_inlier[i], !result.verdicts[i]);
  }
  int num_rejected = 0;
  for (const RejectionCount& count : CountRejections(result.verdicts)) {
    if (count.reason == RejectionReason::kNoRelativePose) {
      EXPECT_EQ(static_cast<int>(count.num_pairs),
                result.summary.num_pairs_without_rotation);
      EXPECT_EQ(count.num_pairs, (pairs.size() + 6) / 7);
    } else {
      num_rejected += static_cast<int>(count.num_pairs);
    }
  }
  EXPECT_EQ(num_rejected, result.summary.num_pairs_dropped);
  EXPECT_GT(num_rejected, static_cast<int>(pairs.size() / 10));
}

// Each rule can be switched off by itself.
TEST(RotationRecipe, RulesCanBeSwitchedOff) {
  SimulationOptions options = SmallSimulation();
  options.relative_rotation_noise_deg = 0.2;
  options.wrong_pair_ratio = 0.2;
  const Simulation simulation = Simulate(options);
  const auto count = [](const EstimatedRotations& result,
                        RejectionReason reason) {
    return std::count(result.verdicts.begin(), result.verdicts.end(), reason);
  };
  constexpr auto kReason = RejectionReason::kRotationBeyondDriftBound;
  EXPECT_GT(count(Estimate(simulation), kReason), 0);
  PairFilteringOptions filtering;
  filtering.use_rotation_consistency = false;
  EXPECT_EQ(count(Estimate(simulation, filtering), kReason), 0);
  filtering = {};
  filtering.use_skeletal_graph = false;
  const EstimatedRotations without = Estimate(simulation, filtering);
  EXPECT_EQ(count(without, kReason), 0);
  EXPECT_LT(MaxFrameErrorDeg(simulation, without.estimate), 1.0);
}

TEST(RestrictToPairs, SplitsComponentsAndDropsUnconnectedFrames) {
  SimulationOptions options = SmallSimulation();
  options.rig = RigPreset::kMono;
  const Simulation simulation = Simulate(options);
  const RotationEstimate all = Estimate(simulation).estimate;
  const auto& images = simulation.scene.images;
  // Frames 0 to 9 and 10 to 22; frame 23 has no pair.
  Mask is_kept = all.pair_is_inlier;
  for (size_t i = 0; i < is_kept.size(); ++i) {
    const ImagePair& pair = simulation.view_graph.pairs[i];
    const auto part = [&](int image_idx) {
      const int frame = images[image_idx].frame_idx;
      return frame < 10 ? 0 : frame < 23 ? 1 : 2;
    };
    if (part(pair.image_idx1) != part(pair.image_idx2)) is_kept[i] = false;
  }
  const RotationEstimate some =
      RestrictToPairs(simulation.scene, simulation.view_graph, is_kept, all);
  EXPECT_EQ(some.pair_is_inlier, is_kept);
  for (int f = 0; f < options.num_frames; ++f) {
    EXPECT_EQ(some.rig_from_world[f].has_value(), f < 23) << f;
    if (f == 23) {
      EXPECT_FALSE(some.component[f].has_value());
      continue;
    }
    EXPECT_EQ(some.component[f], f < 10 ? 1 : 0) << f;
    EXPECT_EQ(some.rig_from_world[f]->coeffs(),
              all.rig_from_world[f]->coeffs());
  }
}

TEST(RotationRecipe, EmptyInputs) {
  const EstimatedRotations nothing = Estimate(Scene(), ViewGraph());
  EXPECT_TRUE(nothing.estimate.rig_from_world.empty());
  Simulation simulation = Simulate(SmallSimulation());
  for (const bool has_pairs : {true, false}) {
    for (ImagePair& pair : simulation.view_graph.pairs) {
      pair.relative_pose.reset();
    }
    if (!has_pairs) simulation.view_graph.pairs.clear();
    const EstimatedRotations result = Estimate(simulation);
    EXPECT_EQ(NumFramesWithRotation(result.estimate), 0);
    EXPECT_EQ(result.estimate.component.size(), simulation.scene.frames.size());
    EXPECT_EQ(result.summary.num_components, 0);
    EXPECT_TRUE(result.estimate.sensor_from_rig[0].has_value());
    EXPECT_FALSE(result.estimate.sensor_from_rig[1].has_value());
    EXPECT_EQ(result.summary.sensors.size(), simulation.scene.sensors.size());
    EXPECT_FALSE(result.summary.median_error_deg.has_value());
    for (const auto& verdict : result.verdicts) EXPECT_TRUE(verdict);
  }
}

}  // namespace
}  // namespace mgsfm

// SPDX-License-Identifier: BSD-3-Clause
// Vehicles that stay at a constant distance for tens of frames and fill images,
// and pedestrians.
#include <gtest/gtest.h>

#include <algorithm>
#include <utility>

#include "mgsfm/mapper/mapper.h"
#include "mgsfm/simulator/simulation.h"
#include "support/model_comparison.h"
#include "support/threads.h"

namespace mgsfm {
namespace {

// Lorries ahead or alongside accompany half of the drive.
Simulation DriveWithLorries(RigPreset rig, int seed) {
  SimulationOptions options = StandardSimulation(rig);
  options.path = PathPreset::kCurve;
  options.num_frames = 90;
  options.frame_spacing_m = 2.5;
  options.convoy_ratio = 0.5;
  options.random_seed = seed;
  return Simulate(options);
}

MapperResult Map(const Simulation& simulation, const MapperOptions& options,
                 int num_threads) {
  return RunMapper({simulation.scene, simulation.view_graph}, options,
                   Threads(num_threads));
}

double MaxPositionError(const Simulation& simulation,
                        bool use_motion_continuity) {
  MapperOptions options;
  options.pair_filtering.use_motion_continuity = use_motion_continuity;
  const MapperResult result = Map(simulation, options, 1);
  EXPECT_EQ(result.models.size(), 1u);
  EXPECT_TRUE(result.unregistered_frames.empty());
  EXPECT_FALSE(result.motion_was_refuted);
  for (const RejectionCount& count : result.rejected_pairs) {
    if (count.reason != RejectionReason::kDiscontinuousMotion) continue;
    EXPECT_EQ(count.num_pairs > 0, use_motion_continuity);
  }
  return CompareModels(simulation.scene, result.models[0].reconstruction,
                       simulation.ground_truth)
      .max_position;
}

class MovingObjectsTest
    : public testing::TestWithParam<std::pair<RigPreset, int>> {};

TEST_P(MovingObjectsTest, LorriesThatKeepTheirDistanceDoNotStopTheRig) {
  const Simulation simulation =
      DriveWithLorries(GetParam().first, GetParam().second);
  // The drive needs the rule: the rig would stand still next to a lorry.
  EXPECT_GT(MaxPositionError(simulation, false), 2.5);
  EXPECT_LT(MaxPositionError(simulation, true), 0.25);
}

// The motions of the rig between frames are estimated in parallel.
TEST(MovingObjectsDriveTest, ThreadsDoNotChangeAnyPose) {
  const Simulation simulation = DriveWithLorries(RigPreset::kStereo, 0);
  MapperOptions options;
  options.pair_filtering.use_motion_continuity = true;
  const MapperResult one = Map(simulation, options, 1);
  const MapperResult three = Map(simulation, options, 3);
  ASSERT_EQ(one.models.size(), three.models.size());
  for (size_t m = 0; m < one.models.size(); ++m) {
    const Reconstruction& a = one.models[m].reconstruction;
    const Reconstruction& b = three.models[m].reconstruction;
    ASSERT_EQ(a.rig_from_world.size(), b.rig_from_world.size());
    for (size_t i = 0; i < a.rig_from_world.size(); ++i) {
      ASSERT_EQ(a.rig_from_world[i].has_value(),
                b.rig_from_world[i].has_value());
      if (!a.rig_from_world[i]) continue;
      EXPECT_EQ(a.rig_from_world[i]->translation,
                b.rig_from_world[i]->translation);
      EXPECT_EQ(a.rig_from_world[i]->rotation.coeffs(),
                b.rig_from_world[i]->rotation.coeffs());
    }
  }
}

INSTANTIATE_TEST_SUITE_P(RigsAndSeeds, MovingObjectsTest,
                         testing::Values(std::pair(RigPreset::kStereo, 1),
                                         std::pair(RigPreset::kKitti360, 1),
                                         std::pair(RigPreset::kKitti360, 2)));

// A rig that moves by a hundredth of a meter per frame: the directions of its
// baselines are noise. Rotations are averaged again only if pairs contradict
// the path.
TEST(StandingRigTest, NoiseIsNoMovingObject) {
  SimulationOptions options = StreetSimulation(RigPreset::kStereo);
  options.num_frames = 30;
  options.frame_spacing_m = 0.01;
  options.pixel_noise_px = 0.5;
  options.random_seed = 3;
  const Simulation simulation = Simulate(options);
  MapperOptions mapper_options;
  mapper_options.pair_filtering.use_motion_continuity = true;
  const MapperResult result = RunMapper(
      {simulation.scene, simulation.view_graph}, mapper_options, Context());
  EXPECT_EQ(std::count_if(result.times.begin(), result.times.end(),
                          [](const StageTime& stage) {
                            return stage.stage == "rotation averaging";
                          }),
            1);
}

// A world at 3 Hz, with 25 % mismatches.
Simulation SimulateWorld(WorldPreset world) {
  SimulationOptions options = WorldSimulation(world, NoiseLevel::kMedium);
  options.frame_rate_hz = 3.0;
  options.random_seed = 2;
  return Simulate(options);
}

ModelDifference CompareFirstModel(const Simulation& simulation,
                                  const MapperResult& result) {
  return CompareModels(simulation.scene, result.models.at(0).reconstruction,
                       simulation.ground_truth);
}

// The rule takes the cabin of an elevator for the scene. The model refutes
// this, and the result is the one without the rule.
TEST(ElevatorTest, MotionsThatTheModelRefutesRejectNoPair) {
  const Simulation simulation = SimulateWorld(WorldPreset::kElevator);
  MapperOptions without_rule;
  without_rule.pair_filtering.use_motion_continuity = false;
  const MapperResult result = Map(simulation, {}, 2);
  const MapperResult expected = Map(simulation, without_rule, 2);
  EXPECT_TRUE(result.motion_was_refuted);
  EXPECT_FALSE(expected.motion_was_refuted);
  for (const RejectionCount& count : result.rejected_pairs) {
    if (count.reason == RejectionReason::kDiscontinuousMotion) {
      EXPECT_EQ(count.num_pairs, 0);
    }
  }
  ASSERT_EQ(result.models.size(), 1u);
  EXPECT_EQ(result.models[0].confidence.seams.size(),
            expected.models.at(0).confidence.seams.size());
  const ModelDifference difference =
      CompareModels(simulation.scene, result.models[0].reconstruction,
                    expected.models.at(0).reconstruction);
  EXPECT_EQ(difference.num_images,
            static_cast<int>(simulation.scene.images.size()));
  EXPECT_LT(difference.max_position, 1e-9);
}

// The points of a pedestrian agree with a slightly wrong path for some frames.
TEST(PedestriansTest, PointsOfFewFramesDoNotBendThePath) {
  const Simulation simulation = SimulateWorld(WorldPreset::kPedestrians);
  const MapperResult result = Map(simulation, {}, 2);
  ASSERT_EQ(result.models.size(), 1u);
  const ModelDifference difference = CompareFirstModel(simulation, result);
  EXPECT_GE(difference.num_images,
            static_cast<int>(simulation.scene.images.size()) * 9 / 10);
  EXPECT_LT(difference.max_position, 0.25);
}

// The wheelhouse decides the verification of nearly all pairs: it has four
// times as many matches as the scenery, which is among the outliers. The cells
// that are found first expose the scenery, which shows that the ship turns, and
// thus the other cells.
TEST(WheelhouseTest, TheSceneryBehindItsWindowsIsMapped) {
  Simulation simulation = SimulateWorld(WorldPreset::kBridge);
  const MapperResult result = Map(simulation, {}, 2);
  ASSERT_EQ(result.models.size(), 1u);
  const ModelDifference difference = CompareFirstModel(simulation, result);
  EXPECT_EQ(difference.num_images,
            static_cast<int>(simulation.scene.images.size()));
  constexpr double kMaxError_m = 0.5;  // on a way of 110 m
  EXPECT_LT(difference.max_position, kMaxError_m);
  for (ImagePair& pair : simulation.view_graph.pairs) pair.outliers.clear();
  EXPECT_GT(CompareFirstModel(simulation, Map(simulation, {}, 2)).max_position,
            kMaxError_m);
}

}  // namespace
}  // namespace mgsfm

// SPDX-License-Identifier: BSD-3-Clause
#include "mgsfm/mapper/mapper.h"

#include <gtest/gtest.h>

#include <algorithm>

#include "geometry/so3.h"
#include "mapper/mapper_recipe.h"
#include "mapper/true_model.h"
#include "mgsfm/models/scene_loading.h"
#include "mgsfm/simulator/simulation.h"
#include "support/model_comparison.h"
#include "support/permuted_ids.h"
#include "support/threads.h"

namespace mgsfm {
namespace {

SimulationOptions NoisyDrive(RigPreset rig, PathPreset path) {
  SimulationOptions options;
  options.rig = rig;
  options.path = path;
  options.num_frames = 15;
  options.max_num_features_per_image = 300;
  options.pixel_noise_px = 0.5;
  options.mismatch_ratio = 0.05;
  options.relative_rotation_noise_deg = 0.3;
  return options;
}

MapperResult Map(const Simulation& simulation, int num_threads = 2) {
  return RunMapper({simulation.scene, simulation.view_graph}, MapperOptions(),
                   Threads(num_threads));
}

class MapperTest
    : public testing::TestWithParam<std::pair<RigPreset, PathPreset>> {};

TEST_P(MapperTest, RecoversANoisyDrive) {
  const Simulation simulation =
      Simulate(NoisyDrive(GetParam().first, GetParam().second));
  ExpectTrueModel(simulation, Map(simulation));
}

INSTANTIATE_TEST_SUITE_P(
    RigsAndPaths, MapperTest,
    testing::Values(std::pair(RigPreset::kMono, PathPreset::kLoop),
                    std::pair(RigPreset::kStereo, PathPreset::kCurve),
                    std::pair(RigPreset::kStereo, PathPreset::kStraight),
                    std::pair(RigPreset::kKitti360, PathPreset::kCurve),
                    std::pair(RigPreset::kCube6, PathPreset::kCurve)));

TEST(MapperTest, StandingRigKeepsAllFramesInOnePlace) {
  const Simulation simulation =
      Simulate(NoisyDrive(RigPreset::kStereo, PathPreset::kStanding));
  const MapperResult result = Map(simulation);
  ASSERT_EQ(result.models.size(), 1u);
  const Reconstruction& model = result.models[0].reconstruction;
  const Rigid3& right_from_rig = *model.sensor_from_rig[1];
  const Rigid3& true_right_from_rig =
      *simulation.ground_truth.sensor_from_rig[1];
  EXPECT_LT(RadToDeg(AngleBetween(right_from_rig.rotation,
                                  true_right_from_rig.rotation)),
            0.05);
  EXPECT_LT(RadToDeg(AngleBetween(right_from_rig.translation,
                                  true_right_from_rig.translation)),
            2.0);
  const double baseline = right_from_rig.translation.norm();
  for (const auto& pose : model.rig_from_world) {
    ASSERT_TRUE(pose.has_value());
    EXPECT_LT((pose->Center() - model.rig_from_world[0]->Center()).norm(),
              0.05 * baseline);
  }
}

TEST(MapperTest, KnownExtrinsicsGiveMetricScale) {
  SimulationOptions options =
      NoisyDrive(RigPreset::kStereo, PathPreset::kCurve);
  options.extrinsics_are_known = true;
  const Simulation simulation = Simulate(options);
  const MapperResult result = Map(simulation);
  ASSERT_EQ(result.models.size(), 1u);
  EXPECT_NEAR(CompareModels(simulation.scene, result.models[0].reconstruction,
                            simulation.ground_truth)
                  .scale,
              1.0, 0.005);
}

// Two drives that share no image pair.
TEST(MapperTest, EachConnectedComponentBecomesAModel) {
  const Simulation simulation =
      Simulate(NoisyDrive(RigPreset::kStereo, PathPreset::kCurve));
  ViewGraph parted;
  for (const ImagePair& pair : simulation.view_graph.pairs) {
    const auto is_late = [&](int image_idx) {
      return simulation.scene.images[image_idx].frame_idx >= 9;
    };
    if (is_late(pair.image_idx1) == is_late(pair.image_idx2)) {
      parted.pairs.push_back(pair);
    }
  }
  const MapperResult result =
      RunMapper({simulation.scene, parted}, MapperOptions(), Threads(2));
  ASSERT_EQ(result.models.size(), 2u);
  for (size_t i = 0; i < 2; ++i) {
    const ModelDifference difference =
        CompareModels(simulation.scene, result.models[i].reconstruction,
                      simulation.ground_truth);
    EXPECT_EQ(difference.num_images, i == 0 ? 18 : 12);
    EXPECT_LT(difference.max_position, 0.1);
  }
}

TEST(MapperTest, EveryUnregisteredFrameHasAReason) {
  Simulation simulation =
      Simulate(NoisyDrive(RigPreset::kStereo, PathPreset::kCurve));
  simulation.view_graph.pairs.clear();
  const MapperResult result = Map(simulation);
  EXPECT_TRUE(result.models.empty());
  ASSERT_EQ(result.unregistered_frames.size(), simulation.scene.frames.size());
  for (const UnregisteredFrame& frame : result.unregistered_frames) {
    EXPECT_FALSE(frame.reason.empty());
  }
}

TEST(MapperTest, ThreadsDoNotChangeTheResult) {
  const Simulation simulation =
      Simulate(NoisyDrive(RigPreset::kKitti360, PathPreset::kCurve));
  const MapperResult one = Map(simulation, 1);
  const MapperResult two = Map(simulation, 2);
  ASSERT_EQ(one.models.size(), 1u);
  ASSERT_EQ(two.models.size(), 1u);
  EXPECT_LT(MaxPoseDifference(one.models[0].reconstruction,
                              two.models[0].reconstruction),
            1e-9);
}

// A step that corrects the rotations: here by a turn of the world, which any
// later stage with the rotations of averaging would contradict.
PositionResult EstimateInATurnedWorld(const PositionInput& input,
                                      const PositionOptions& options,
                                      const Context& context) {
  const Eigen::Quaterniond turn = ExpSO3({0.3, -0.5, 0.2});
  PositionResult result = EstimatePositions(input, options, context);
  result.corrected_rig_from_world = input.rotations.rig_from_world;
  for (auto& rotation : *result.corrected_rig_from_world) {
    if (rotation) rotation = *rotation * turn.inverse();
  }
  for (auto* positions : {&result.estimate.frame_center_in_world,
                          &result.estimate.point_in_world}) {
    for (auto& position : *positions) {
      if (position) position = turn * *position;
    }
  }
  return result;
}

TEST(MapperTest, LaterStagesUseTheRotationsThatPositionsHoldFor) {
  const Simulation simulation =
      Simulate(NoisyDrive(RigPreset::kStereo, PathPreset::kCurve));
  const MapperResult result = RunMapperWith(
      EstimateInATurnedWorld, {simulation.scene, simulation.view_graph},
      MapperOptions(), Threads(2));
  ASSERT_EQ(result.models.size(), 1u);
  const ModelDifference difference =
      CompareModels(simulation.scene, result.models[0].reconstruction,
                    simulation.ground_truth);
  EXPECT_LT(difference.max_rotation_deg, 0.2);
  EXPECT_LT(difference.max_position, 0.1);
  // The first bundle adjustment starts close to its minimum.
  const SolveSummary& solve = result.models[0].bundle.solves.front();
  EXPECT_LT(solve.initial_cost, 2.0 * solve.final_cost);
}

TEST(MapperTest, AnObserverSeesTheModelGrowAndChangesNothing) {
  const Simulation simulation =
      Simulate(NoisyDrive(RigPreset::kStereo, PathPreset::kCurve));
  std::vector<std::pair<size_t, size_t>> sizes;  // frames, points
  MapperInput input{simulation.scene, simulation.view_graph};
  input.observer = [&](const Reconstruction& model) {
    const auto& poses = model.rig_from_world;
    sizes.emplace_back(
        std::count_if(poses.begin(), poses.end(),
                      [](const auto& pose) { return pose.has_value(); }),
        model.points.size());
  };
  const MapperResult observed = RunMapper(input, MapperOptions(), Threads(2));
  // All frames with points from the first positions on; at last the model of
  // the result.
  ASSERT_GE(sizes.size(), 4u);
  EXPECT_EQ(sizes.front().first, simulation.scene.frames.size());
  EXPECT_GT(sizes.front().second, sizes.back().second / 2);
  const Reconstruction& last = observed.models[0].reconstruction;
  EXPECT_EQ(sizes.back().second, last.points.size());
  EXPECT_EQ(MaxPoseDifference(last, Map(simulation).models[0].reconstruction),
            0.0);
}

TEST(MapperTest, IdsDoNotChangeTheResult) {
  const Simulation simulation =
      Simulate(NoisyDrive(RigPreset::kStereo, PathPreset::kCurve));
  DatabaseContents contents =
      MakeDatabaseContents(simulation.scene, simulation.view_graph);
  contents.rigs.clear();
  contents.frames.clear();
  std::vector<Reconstruction> models;
  for (const DatabaseContents& input : {contents, WithPermutedIds(contents)}) {
    const LoadedScene loaded =
        LoadScene(input, SceneLoadingOptions(), Threads(1));
    MapperResult result = RunMapper({loaded.scene, loaded.view_graph},
                                    MapperOptions(), Threads(1));
    ASSERT_EQ(result.models.size(), 1u);
    models.push_back(std::move(result.models[0].reconstruction));
  }
  EXPECT_LT(MaxPoseDifference(models[0], models[1]), 1e-9);
}

}  // namespace
}  // namespace mgsfm

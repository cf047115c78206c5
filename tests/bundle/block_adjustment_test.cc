// SPDX-License-Identifier: BSD-3-Clause
#include <gtest/gtest.h>

#include <algorithm>

#include "bundle/block_solve.h"
#include "bundle/bundle_fixtures.h"
#include "support/model_comparison.h"

namespace mgsfm {
namespace {

SimulationOptions NoisyDrive(RigPreset rig, PathPreset path) {
  SimulationOptions options = SmallScene(rig, path);
  options.num_frames = 24;
  options.pixel_noise_px = 0.5;
  return options;
}

BlockedModel Split(const Scene& scene, const Reconstruction& model,
                   int num_blocks) {
  FrameBlocks blocks;
  const size_t num_frames = scene.frames.size();
  for (size_t i = 0; i < num_frames; ++i) {
    blocks.push_back(static_cast<int>(i * num_blocks / num_frames));
  }
  BlockedModel split{model, std::vector<PointBlock>(num_blocks)};
  split.poses.points.clear();
  for (const Point3D& point : model.points) {
    split.blocks[BlockOf(scene, blocks, point)].Add(point);
  }
  return split;
}

class BlockAdjustmentTest
    : public testing::TestWithParam<std::tuple<RigPreset, PathPreset>> {};

// On a loop, the last block observes points of the first one.
TEST_P(BlockAdjustmentTest, MinimumIsThatOfTheWholeModel) {
  const auto [rig, path] = GetParam();
  const Simulation simulation = Simulate(NoisyDrive(rig, path));
  const Reconstruction initial =
      Perturbed(simulation.scene, simulation.ground_truth, 0.01, 5);
  BundleAdjustmentOptions options;
  options.function_tolerance = 1e-12;
  const BundleResult whole =
      AdjustBundle(simulation.scene, initial, options, Threads(2));
  for (const int num_blocks : {1, 4}) {
    BlockedModel blocked = Split(simulation.scene, initial, num_blocks);
    const BundleSummary summary =
        AdjustBundleInBlocks(simulation.scene, options, Threads(2), &blocked);
    const SolveSummary& solve = summary.solves.at(0);
    EXPECT_EQ(solve.termination, Termination::kConverged);
    const double cost = whole.summary.solves.at(0).final_cost;
    EXPECT_NEAR(solve.initial_cost, whole.summary.solves.at(0).initial_cost,
                1e-9 * solve.initial_cost);
    EXPECT_NEAR(solve.final_cost, cost, 1e-7 * cost);
    const ModelDifference difference =
        CompareModels(simulation.scene, blocked.poses, whole.estimate);
    EXPECT_LT(difference.max_position, 1e-3);
    EXPECT_LT(difference.max_rotation_deg, 1e-2);
  }
}

INSTANTIATE_TEST_SUITE_P(
    Rigs, BlockAdjustmentTest,
    testing::Combine(testing::Values(RigPreset::kMono, RigPreset::kStereo,
                                     RigPreset::kKitti360),
                     testing::Values(PathPreset::kCurve, PathPreset::kLoop)));

}  // namespace
}  // namespace mgsfm

// SPDX-License-Identifier: BSD-3-Clause
#include <gtest/gtest.h>

#include "bundle_adjustment/solve.h"
#include "estimation/bundle_adjustment/bundle_fixtures.h"
#include "scene/observations.h"
#include "support/model_comparison.h"

namespace mgsfm {
namespace {

SimulationOptions NoisyLoop() {
  SimulationOptions options = SmallScene(RigPreset::kStereo, PathPreset::kLoop);
  options.num_frames = 20;
  options.pixel_noise_px = 0.5;
  return options;
}

// The poses of half of the observations have about sqrt(2) times the error.
TEST(RefineBySelectedTracksTest, FewObservationsPoseAllFramesAndPoints) {
  const Simulation simulation = Simulate(NoisyLoop());
  const Scene& scene = simulation.scene;
  const Reconstruction initial =
      Perturbed(scene, simulation.ground_truth, 0.01, 5);
  const size_t max_num_observations = NumObservations(initial) / 2;
  const BundleAdjustmentOptions options;
  const BundleResult all =
      RefineReconstruction(scene, FixedCandidates(GroupTracks(initial)),
                           initial, options, Threads(2));
  const BundleResult few = RefineBySelectedTracks(
      scene, initial, options, max_num_observations, Threads(2));
  EXPECT_LE(few.summary.rounds.front().num_observations_before,
            max_num_observations);
  EXPECT_GT(few.summary.rounds.front().num_observations_before,
            max_num_observations / 2);
  EXPECT_GT(NumObservations(few.estimate),
            NumObservations(all.estimate) * 97 / 100);
  const ModelDifference difference =
      CompareModels(scene, few.estimate, simulation.ground_truth);
  const ModelDifference reference =
      CompareModels(scene, all.estimate, simulation.ground_truth);
  EXPECT_EQ(difference.num_images, reference.num_images);
  EXPECT_LT(difference.max_position, 2.0 * reference.max_position);
}

TEST(RefineBySelectedTracksTest, AllObservationsReachTheUsualOptimum) {
  const Simulation simulation = Simulate(NoisyLoop());
  const Reconstruction initial =
      Perturbed(simulation.scene, simulation.ground_truth, 0.01, 6);
  BundleAdjustmentOptions options;
  options.function_tolerance = 1e-13;
  const BundleResult all = RefineReconstruction(
      simulation.scene, FixedCandidates(GroupTracks(initial)), initial, options,
      Threads(2));
  const BundleResult selected = RefineBySelectedTracks(
      simulation.scene, initial, options, NumObservations(initial), Threads(2));
  const ModelDifference difference =
      CompareModels(simulation.scene, all.estimate, selected.estimate);
  EXPECT_LT(difference.max_position, 1e-4);
}

}  // namespace
}  // namespace mgsfm

// SPDX-License-Identifier: BSD-3-Clause
// Frames removed from true models are registered at their true poses.
#include <gtest/gtest.h>

#include "geometry/so3.h"
#include "mgsfm/registration/model_extension.h"
#include "mgsfm/simulator/simulation.h"
#include "support/partial_model.h"

namespace mgsfm {
namespace {

SimulationOptions Drive(RigPreset rig, double noise_px) {
  SimulationOptions options;
  options.rig = rig;
  options.num_frames = 12;
  options.max_num_features_per_image = 300;
  options.pixel_noise_px = noise_px;
  options.mismatch_ratio = noise_px > 0.0 ? 0.2 : 0.0;
  return options;
}

// Two rigs of two forward-looking cameras, one above the other.
Simulation TwoRigs(double noise_px) {
  SimulationInput input;
  input.rig = MakeRig(RigPreset::kStereo);
  for (const char* name : {"cam2/", "cam3/"}) {
    SimulatedCamera camera = input.rig[input.rig.size() - 2];
    camera.image_prefix = name;
    camera.sensor_from_rig = Rigid3{ExpSO3({0.05, 0.1, 0.0}), {0.2, 0.3, 0.1}} *
                             camera.sensor_from_rig;
    input.rig.push_back(camera);
  }
  Simulation simulation = Simulate(Drive(RigPreset::kStereo, noise_px), input);
  SplitRig(2, &simulation);
  CheckConsistent(simulation.scene);
  return simulation;
}

ResectionResult Resect(const Simulation& simulation,
                       const Reconstruction& model, int num_threads = 2) {
  Context context;
  context.num_threads = num_threads;
  return ResectFrames(simulation.scene, ComputeBearings(simulation.scene, 1),
                      simulation.view_graph, model, ResectionOptions(),
                      context);
}

void ExpectNear(const Rigid3& pose, const Rigid3& truth, double max_deg,
                double max_m) {
  EXPECT_LT(RadToDeg(AngleBetween(pose.rotation, truth.rotation)), max_deg);
  EXPECT_LT((pose.Center() - truth.Center()).norm(), max_m);
}

// The frames were removed and observe enough of the remaining points.
void ExpectAdded(const Simulation& simulation, const ResectionResult& result,
                 int first, int last, double max_deg, double max_m) {
  for (int i = first; i <= last; ++i) {
    const auto& pose = result.estimate.rig_from_world[i];
    ASSERT_TRUE(pose.has_value()) << i;
    ExpectNear(*pose, *simulation.ground_truth.rig_from_world[i], max_deg,
               max_m);
  }
}

class ResectionTest : public testing::TestWithParam<RigPreset> {};

TEST_P(ResectionTest, RegistersExactFramesExactly) {
  const Simulation simulation = Simulate(Drive(GetParam(), 0.0));
  const Reconstruction model =
      WithoutFrames(simulation.scene, simulation.ground_truth,
                    [](int i) { return i == 3 || i >= 10; });
  const ResectionResult result = Resect(simulation, model);
  ASSERT_EQ(result.frames.size(), 3u);
  ExpectAdded(simulation, result, 3, 3, 1e-4, 1e-4);
  ExpectAdded(simulation, result, 10, 11, 1e-4, 1e-4);
  // The model is unchanged.
  EXPECT_EQ(result.estimate.points.size(), model.points.size());
  EXPECT_EQ(result.estimate.rig_from_world[0]->translation,
            model.rig_from_world[0]->translation);
}

TEST_P(ResectionTest, RegistersNoisyFramesApproximately) {
  const Simulation simulation = Simulate(Drive(GetParam(), 0.5));
  const ResectionResult result = Resect(
      simulation, WithoutFrames(simulation.scene, simulation.ground_truth,
                                [](int i) { return i >= 10; }));
  ExpectAdded(simulation, result, 10, 11, 0.2, 0.1);
}

INSTANTIATE_TEST_SUITE_P(Rigs, ResectionTest,
                         testing::Values(RigPreset::kMono, RigPreset::kStereo,
                                         RigPreset::kKitti360,
                                         RigPreset::kCube6));

// The forward camera has no matches; the side cameras determine the pose.
TEST(Resection, CamerasOfAFrameHelpEachOther) {
  Simulation simulation = Simulate(Drive(RigPreset::kKitti360, 0.0));
  for (ImagePair& pair : simulation.view_graph.pairs) {
    for (const int image_idx : {pair.image_idx1, pair.image_idx2}) {
      const Image& image = simulation.scene.images[image_idx];
      if (image.frame_idx == 11 && image.sensor_idx < 2) pair.matches.clear();
    }
  }
  const ResectionResult result = Resect(
      simulation, WithoutFrames(simulation.scene, simulation.ground_truth,
                                [](int i) { return i == 11; }));
  ExpectAdded(simulation, result, 11, 11, 1e-4, 1e-4);
}

TEST(Resection, FramesWithoutMatchesAreCounted) {
  Simulation simulation = Simulate(Drive(RigPreset::kStereo, 0.0));
  const Reconstruction model = WithoutFrames(
      simulation.scene, simulation.ground_truth, [](int i) { return i >= 4; });
  const ResectionResult result = Resect(simulation, model);
  ASSERT_EQ(result.frames.size(), 8u);
  EXPECT_TRUE(result.frames[0].is_added);
  EXPECT_GE(result.frames[0].num_inliers, 30);
  EXPECT_EQ(result.frames[0].num_images, 2);
  // Matched with three frames only.
  EXPECT_FALSE(result.frames[7].is_added);
  EXPECT_EQ(result.frames[7].num_keypoints, 0);
  EXPECT_FALSE(result.estimate.rig_from_world[11].has_value());
}

TEST(Resection, CalibratesANewRig) {
  for (const double noise_px : {0.0, 0.5}) {
    const Simulation simulation = TwoRigs(noise_px);
    const Scene& scene = simulation.scene;
    const ResectionResult result = Resect(
        simulation, WithoutFrames(scene, simulation.ground_truth, [&](int i) {
          return scene.frames[i].rig_idx == 1;
        }));
    ASSERT_EQ(result.sensors.size(), 1u);
    EXPECT_EQ(result.sensors[0].sensor_idx, 3);
    EXPECT_GE(result.sensors[0].num_frames, 10);
    const double factor = noise_px > 0.0 ? 1.0 : 1e-3;
    ExpectNear(*result.estimate.sensor_from_rig[3],
               *simulation.ground_truth.sensor_from_rig[3], 0.1 * factor,
               0.1 * factor);
    for (size_t i = 0; i < scene.frames.size(); ++i) {
      if (scene.frames[i].rig_idx == 0) continue;
      ASSERT_TRUE(result.estimate.rig_from_world[i].has_value());
      ExpectNear(*result.estimate.rig_from_world[i],
                 *simulation.ground_truth.rig_from_world[i], 0.2 * factor,
                 0.1 * factor);
    }
  }
}

TEST(Resection, ThreadsDoNotChangeTheResult) {
  const Simulation simulation = TwoRigs(0.5);
  const Scene& scene = simulation.scene;
  const Reconstruction model =
      WithoutFrames(scene, simulation.ground_truth,
                    [&](int i) { return scene.frames[i].rig_idx == 1; });
  const ResectionResult one = Resect(simulation, model, 1);
  const ResectionResult three = Resect(simulation, model, 3);
  for (size_t i = 0; i < scene.frames.size(); ++i) {
    const auto& a = one.estimate.rig_from_world[i];
    const auto& b = three.estimate.rig_from_world[i];
    ASSERT_EQ(a.has_value(), b.has_value());
    if (!a) continue;
    EXPECT_EQ(a->translation, b->translation);
    EXPECT_EQ(a->rotation.coeffs(), b->rotation.coeffs());
  }
}

}  // namespace
}  // namespace mgsfm

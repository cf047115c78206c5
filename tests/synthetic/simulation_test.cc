// SPDX-License-Identifier: BSD-3-Clause
#include "mgsfm/synthetic/simulation.h"

#include <gtest/gtest.h>

#include <set>

namespace mgsfm {
namespace {

SimulationOptions SmallScene(RigPreset rig, PathPreset path) {
  SimulationOptions options;
  options.rig = rig;
  options.path = path;
  options.num_frames = 12;
  return options;
}

class SimulationTest
    : public testing::TestWithParam<std::tuple<RigPreset, PathPreset>> {};

TEST_P(SimulationTest, KeypointsAreProjectionsOfTheTruth) {
  const auto [rig, path] = GetParam();
  const Simulation simulation = Simulate(SmallScene(rig, path));
  const Scene& scene = simulation.scene;
  ASSERT_GT(simulation.ground_truth.points.size(), 100u);
  for (const Point3D& point : simulation.ground_truth.points) {
    for (const Observation& o : point.track) {
      const Image& image = scene.images[o.image_idx];
      const Camera& camera = scene.cameras[image.camera_idx];
      const auto cam_from_world =
          simulation.ground_truth.CamFromWorld(scene, o.image_idx);
      ASSERT_TRUE(cam_from_world.has_value());
      const auto pixel = ProjectToPixel(camera.model, camera.params.data(),
                                        *cam_from_world * point.point_in_world);
      ASSERT_TRUE(pixel.has_value());
      EXPECT_LT(
          (pixel->cast<float>() - image.keypoints_px[o.keypoint_idx]).norm(),
          1e-3);
    }
  }
}

TEST_P(SimulationTest, EveryImageIsMatched) {
  const auto [rig, path] = GetParam();
  const Simulation simulation = Simulate(SmallScene(rig, path));
  std::set<int> matched;
  for (const ImagePair& pair : simulation.view_graph.pairs) {
    EXPECT_LT(pair.image_idx1, pair.image_idx2);
    matched.insert(pair.image_idx1);
    matched.insert(pair.image_idx2);
  }
  EXPECT_EQ(matched.size(), simulation.scene.images.size());
}

INSTANTIATE_TEST_SUITE_P(
    AllPresets, SimulationTest,
    testing::Combine(testing::Values(RigPreset::kMono, RigPreset::kStereo,
                                     RigPreset::kKitti360, RigPreset::kCube6),
                     testing::Values(PathPreset::kLoop, PathPreset::kCurve,
                                     PathPreset::kStraight,
                                     PathPreset::kStanding)));

TEST(SimulationTest, MatchesJoinTheSamePoint) {
  const Simulation simulation =
      Simulate(SmallScene(RigPreset::kStereo, PathPreset::kCurve));
  std::set<std::pair<Observation, Observation>> joined;
  for (const Point3D& point : simulation.ground_truth.points) {
    for (const Observation& a : point.track) {
      for (const Observation& b : point.track) joined.insert({a, b});
    }
  }
  for (const ImagePair& pair : simulation.view_graph.pairs) {
    for (const Match& match : pair.matches) {
      const Observation a{pair.image_idx1,
                          static_cast<int>(match.keypoint_idx1)};
      const Observation b{pair.image_idx2,
                          static_cast<int>(match.keypoint_idx2)};
      EXPECT_EQ(joined.count({a, b}), 1u);
    }
  }
}

TEST(SimulationTest, SeedDecidesEverything) {
  SimulationOptions options =
      SmallScene(RigPreset::kStereo, PathPreset::kCurve);
  options.pixel_noise_px = 1.0;
  options.mismatch_ratio = 0.1;
  options.missing_image_ratio = 0.2;
  const Simulation a = Simulate(options);
  const Simulation b = Simulate(options);
  options.random_seed = 1;
  const Simulation c = Simulate(options);
  ASSERT_EQ(a.scene.images.size(), b.scene.images.size());
  for (size_t i = 0; i < a.scene.images.size(); ++i) {
    EXPECT_EQ(a.scene.images[i].keypoints_px, b.scene.images[i].keypoints_px);
  }
  EXPECT_NE(a.scene.images[0].keypoints_px, c.scene.images[0].keypoints_px);
  EXPECT_LT(a.scene.images.size(), 24u);
}

}  // namespace
}  // namespace mgsfm

// SPDX-License-Identifier: BSD-3-Clause
// The written files reproduce the simulation.
#include <gtest/gtest.h>

#include <filesystem>

#include "mgsfm/models/model_io.h"
#include "mgsfm/models/scene_loading.h"
#include "mgsfm/simulator/simulation.h"
#include "support/temp_dir.h"

namespace mgsfm {
namespace {

Simulation HardDrive(RigPreset rig) {
  SimulationOptions options = StandardSimulation(rig);
  options.num_frames = 15;
  options.frame_spacing_m = 1.5;
  options.missing_image_ratio = 0.1;
  return Simulate(options);
}

class FilesTest
    : public testing::TestWithParam<std::pair<RigPreset, DatabaseSchema>> {};

TEST_P(FilesTest, TheDatabaseReadBackIsTheSimulation) {
  const auto [rig, schema] = GetParam();
  const Simulation simulation = HardDrive(rig);
  const TempDir dir;
  const std::string path = (dir.path() / "database.db").string();
  WriteDatabase(path,
                MakeDatabaseContents(simulation.scene, simulation.view_graph),
                schema);
  const LoadedScene loaded = LoadScene(path, {}, {});
  ASSERT_EQ(loaded.scene.images.size(), simulation.scene.images.size());
  ASSERT_EQ(loaded.scene.frames.size(), simulation.scene.frames.size());
  for (size_t i = 0; i < loaded.scene.images.size(); ++i) {
    const Image& image = loaded.scene.images[i];
    const Image& expected = simulation.scene.images[i];
    EXPECT_EQ(image.name, expected.name);
    EXPECT_EQ(image.frame_idx, expected.frame_idx);
    EXPECT_EQ(image.sensor_idx, expected.sensor_idx);
    EXPECT_EQ(image.keypoints_px, expected.keypoints_px);
  }
  ASSERT_EQ(loaded.view_graph.pairs.size(), simulation.view_graph.pairs.size());
  for (size_t i = 0; i < loaded.view_graph.pairs.size(); ++i) {
    const ImagePair& pair = loaded.view_graph.pairs[i];
    const ImagePair& expected = simulation.view_graph.pairs[i];
    EXPECT_EQ(pair.image_idx1, expected.image_idx1);
    EXPECT_EQ(pair.image_idx2, expected.image_idx2);
    EXPECT_EQ(pair.config, expected.config);
    // Exact up to rounding if the ids swap the images.
    ASSERT_TRUE(pair.E && expected.E && pair.relative_pose);
    EXPECT_LT((*pair.E - *expected.E).norm(), 1e-12);
    EXPECT_LT(pair.relative_pose->cam2_from_cam1.angularDistance(
                  expected.relative_pose->cam2_from_cam1),
              1e-7);
    EXPECT_LT((*pair.relative_pose->translation_direction -
               *expected.relative_pose->translation_direction)
                  .norm(),
              1e-12);
    ASSERT_EQ(pair.matches.size(), expected.matches.size());
    for (size_t j = 0; j < pair.matches.size(); ++j) {
      EXPECT_EQ(pair.matches[j].keypoint_idx1,
                expected.matches[j].keypoint_idx1);
      EXPECT_EQ(pair.matches[j].keypoint_idx2,
                expected.matches[j].keypoint_idx2);
    }
  }
}

INSTANTIATE_TEST_SUITE_P(
    AllSchemas, FilesTest,
    testing::Values(std::pair(RigPreset::kStereo, DatabaseSchema::k38),
                    std::pair(RigPreset::kKitti360, DatabaseSchema::k312)));

TEST(FilesTest, TheTruthIsAModel) {
  const Simulation simulation = HardDrive(RigPreset::kKitti360);
  const TempDir dir;
  WriteModel(dir.path(), simulation.scene, simulation.ground_truth,
             ModelFormat::kBinary);
  const Model model = ReadModel(dir.path());
  EXPECT_EQ(model.poses.images.size(), simulation.scene.images.size());
  EXPECT_EQ(model.poses.frames.size(), simulation.scene.frames.size());
  ASSERT_EQ(model.poses.rigs.size(), 1u);
  EXPECT_EQ(model.poses.rigs.front().sensors.size(), 4u);
  EXPECT_EQ(model.points.size(), simulation.ground_truth.points.size());
}

}  // namespace
}  // namespace mgsfm

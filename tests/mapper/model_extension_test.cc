// SPDX-License-Identifier: BSD-3-Clause
// Models of a part of a drive, which are extended by the rest.
#include "mapper/model_extension.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <string>
#include <vector>

#include "geometry/so3.h"
#include "mapper/model_world.h"
#include "mgsfm/base/error.h"
#include "mgsfm/mapper/mapper.h"
#include "mgsfm/models/scene_loading.h"
#include "mgsfm/simulator/simulation.h"
#include "models/model_placement.h"
#include "support/model_comparison.h"
#include "support/partial_model.h"
#include "support/permuted_ids.h"
#include "support/temp_dir.h"

namespace mgsfm {
namespace {

using testing::HasSubstr;

constexpr int kNumFrames = 20;
constexpr int kNumFirst = 12;  // frames of the first part

Context TwoThreads() {
  Context context;
  context.num_threads = 2;
  return context;
}

SimulationOptions NoisyDrive(RigPreset rig) {
  SimulationOptions options;
  options.rig = rig;
  options.num_frames = kNumFrames;
  options.max_num_features_per_image = 300;
  options.pixel_noise_px = 0.5;
  options.mismatch_ratio = 0.05;
  options.relative_rotation_noise_deg = 0.3;
  return options;
}

// The pairs between frames for which `is_chosen(frame_idx)`.
template <class Predicate>
ViewGraph PairsOf(const Simulation& simulation, const Predicate& is_chosen) {
  ViewGraph chosen;
  const std::vector<Image>& images = simulation.scene.images;
  for (const ImagePair& pair : simulation.view_graph.pairs) {
    if (is_chosen(images[pair.image_idx1].frame_idx) &&
        is_chosen(images[pair.image_idx2].frame_idx)) {
      chosen.pairs.push_back(pair);
    }
  }
  return chosen;
}

bool IsOfExistingModel(int frame_idx) { return frame_idx < kNumFirst; }

Reconstruction MapExistingModel(const Simulation& simulation) {
  const MapperResult result =
      RunMapper({simulation.scene, PairsOf(simulation, IsOfExistingModel)},
                MapperOptions(), TwoThreads());
  MGSFM_CHECK_EQ(result.models.size(), 1u);
  return result.models[0].reconstruction;
}

MapperResult Extend(const Simulation& simulation, const Reconstruction& start,
                    const MapperOptions& options = {}) {
  return RunMapper({simulation.scene, simulation.view_graph, {}, {}, start},
                   options, TwoThreads());
}

MapperOptions Fixed() {
  MapperOptions options;
  options.extension.fix_existing_frames = true;
  return options;
}

class ModelExtensionTest : public testing::TestWithParam<RigPreset> {};

TEST_P(ModelExtensionTest, ExtensionIsAsAccurateAsOneRun) {
  const Simulation simulation = Simulate(NoisyDrive(GetParam()));
  const Scene& scene = simulation.scene;
  const Reconstruction start = MapExistingModel(simulation);
  const MapperResult result = Extend(simulation, start);
  ASSERT_EQ(result.models.size(), 1u);
  EXPECT_TRUE(result.unregistered_frames.empty());
  const Reconstruction& model = result.models[0].reconstruction;
  const ModelDifference error =
      CompareModels(scene, model, simulation.ground_truth);
  EXPECT_EQ(error.num_images, static_cast<int>(scene.images.size()));
  EXPECT_LT(error.max_rotation_deg, 0.2);
  EXPECT_LT(error.max_position, 0.1);

  const MapperResult whole =
      RunMapper({scene, simulation.view_graph}, MapperOptions(), TwoThreads());
  ASSERT_EQ(whole.models.size(), 1u);
  const ModelDifference difference =
      CompareModels(scene, model, whole.models[0].reconstruction);
  EXPECT_LT(difference.max_rotation_deg, 0.02);
  const double unit = CompareModels(scene, simulation.ground_truth,
                                    whole.models[0].reconstruction)
                          .scale;
  EXPECT_LT(difference.max_position, 0.02 * unit);

  const ExtensionSummary& summary = *result.models[0].extension;
  EXPECT_EQ(summary.num_existing_frames, kNumFirst);
  EXPECT_EQ(summary.added_frames.size(), size_t{kNumFrames - kNumFirst});
}

TEST_P(ModelExtensionTest, TheGaugeIsThatOfTheExistingModel) {
  const Simulation simulation = Simulate(NoisyDrive(GetParam()));
  const Reconstruction start = MapExistingModel(simulation);
  const MapperResult result = Extend(simulation, start);
  ASSERT_EQ(result.models.size(), 1u);
  const Sim3 motion = AlignToModel(simulation.scene, start,
                                   result.models[0].reconstruction, false);
  EXPECT_NEAR(motion.scale, 1.0, 1e-9);
  EXPECT_LT(LogSO3(motion.rotation).norm(), 1e-9);
  EXPECT_LT(motion.translation.norm(), 1e-9);
}

TEST_P(ModelExtensionTest, FixedFramesStayToTheLastBit) {
  const Simulation simulation = Simulate(NoisyDrive(GetParam()));
  const Reconstruction start = MapExistingModel(simulation);
  const MapperResult result = Extend(simulation, start, Fixed());
  ASSERT_EQ(result.models.size(), 1u);
  const Reconstruction& model = result.models[0].reconstruction;
  for (int i = 0; i < kNumFirst; ++i) {
    EXPECT_EQ(model.rig_from_world[i]->translation,
              start.rig_from_world[i]->translation);
    EXPECT_EQ(model.rig_from_world[i]->rotation.coeffs(),
              start.rig_from_world[i]->rotation.coeffs());
  }
  for (size_t i = 0; i < start.sensor_from_rig.size(); ++i) {
    EXPECT_EQ(model.sensor_from_rig[i]->translation,
              start.sensor_from_rig[i]->translation);
  }
  EXPECT_TRUE(result.models[0].extension->frames_are_fixed);
  const ModelDifference error =
      CompareModels(simulation.scene, model, simulation.ground_truth);
  EXPECT_EQ(error.num_images, static_cast<int>(simulation.scene.images.size()));
  EXPECT_LT(error.max_position, 0.2);
}

INSTANTIATE_TEST_SUITE_P(Rigs, ModelExtensionTest,
                         testing::Values(RigPreset::kMono, RigPreset::kStereo,
                                         RigPreset::kKitti360));

// Cameras 2 and 3 have other intrinsics and another baseline, and drive by
// later.
Simulation TwoRigs() {
  SimulationInput input;
  input.rig = MakeRig(RigPreset::kStereo);
  for (const char* name : {"cam2/", "cam3/"}) {
    SimulatedCamera camera = input.rig[input.rig.size() - 2];
    camera.image_prefix = name;
    camera.params[0] *= 0.8;
    camera.params[1] *= 0.8;
    camera.sensor_from_rig.translation *= 1.5;
    camera.sensor_from_rig = Rigid3{ExpSO3({0.05, 0.1, 0.0}), {0.2, 0.3, 0.1}} *
                             camera.sensor_from_rig;
    input.rig.push_back(camera);
  }
  Simulation simulation = Simulate(NoisyDrive(RigPreset::kStereo), input);
  SplitRig(2, &simulation);
  return simulation;
}

// A model of the first rig alone.
Reconstruction MapFirstRig(const Simulation& simulation) {
  const Scene& scene = simulation.scene;
  const auto is_of_first = [&](int i) { return scene.frames[i].rig_idx == 0; };
  const MapperResult first = RunMapper(
      {scene, PairsOf(simulation, is_of_first)}, MapperOptions(), TwoThreads());
  MGSFM_CHECK_EQ(first.models.size(), 1u);
  return WithoutFrames(scene, first.models[0].reconstruction,
                       [&](int i) { return !is_of_first(i); });
}

TEST(ModelExtension, ASecondRigJoinsAndIsCalibrated) {
  const Simulation simulation = TwoRigs();
  const Scene& scene = simulation.scene;
  const Reconstruction start = MapFirstRig(simulation);
  const MapperResult result = Extend(simulation, start);
  ASSERT_EQ(result.models.size(), 1u);
  const Reconstruction& model = result.models[0].reconstruction;
  const ModelDifference error =
      CompareModels(scene, model, simulation.ground_truth);
  EXPECT_EQ(error.num_images, static_cast<int>(scene.images.size()));
  EXPECT_LT(error.max_rotation_deg, 0.2);
  EXPECT_LT(error.max_position, 0.1);
  const Rigid3& sensor = *model.sensor_from_rig[3];
  const Rigid3& true_sensor = *simulation.ground_truth.sensor_from_rig[3];
  EXPECT_LT(RadToDeg(AngleBetween(sensor.rotation, true_sensor.rotation)),
            0.05);
  EXPECT_NEAR(sensor.translation.norm() * error.scale,
              true_sensor.translation.norm(), 0.02);
  ASSERT_EQ(result.models[0].extension->placed_sensors.size(), 1u);
}

// The first rig is unknown, so its model has an arbitrary unit of length.
TEST(ModelExtension, AKnownSecondRigTakesTheUnitOfTheModel) {
  Simulation simulation = TwoRigs();
  const Scene& scene = simulation.scene;
  Reconstruction start = MapFirstRig(simulation);
  TransformWorld({0.3, Eigen::Quaterniond::Identity(), Eigen::Vector3d::Zero()},
                 &start);
  simulation.scene.sensors[3].sensor_from_rig =
      simulation.ground_truth.sensor_from_rig[3];
  const MapperResult result = Extend(simulation, start);
  ASSERT_EQ(result.models.size(), 1u);
  const Reconstruction& model = result.models[0].reconstruction;
  const ModelDifference error =
      CompareModels(scene, model, simulation.ground_truth);
  EXPECT_EQ(error.num_images, static_cast<int>(scene.images.size()));
  EXPECT_LT(error.max_position, 0.1);
  EXPECT_NEAR(AlignToModel(scene, start, model, false).scale, 1.0, 1e-9);
}

// The sideways cameras join the existing frames of the forward cameras.
TEST(ModelExtension, CamerasJoinExistingFrames) {
  const Simulation simulation = Simulate(NoisyDrive(RigPreset::kCube6));
  const Scene& scene = simulation.scene;
  ViewGraph pairs_ahead;
  for (const ImagePair& pair : simulation.view_graph.pairs) {
    if (scene.images[pair.image_idx1].sensor_idx == 0 &&
        scene.images[pair.image_idx2].sensor_idx == 0) {
      pairs_ahead.pairs.push_back(pair);
    }
  }
  const MapperResult first =
      RunMapper({scene, pairs_ahead}, MapperOptions(), TwoThreads());
  ASSERT_EQ(first.models.size(), 1u);
  Reconstruction start = first.models[0].reconstruction;
  for (size_t i = 1; i < start.sensor_from_rig.size(); ++i) {
    start.sensor_from_rig[i].reset();
  }
  const MapperResult result = Extend(simulation, start);
  ASSERT_EQ(result.models.size(), 1u);
  const ModelDifference error = CompareModels(
      scene, result.models[0].reconstruction, simulation.ground_truth);
  EXPECT_EQ(error.num_images, static_cast<int>(scene.images.size()));
  EXPECT_LT(error.max_position, 0.1);
}

TEST(ModelExtension, KnownRigsKeepTheModelMetric) {
  SimulationOptions options = NoisyDrive(RigPreset::kStereo);
  options.extrinsics_are_known = true;
  const Simulation simulation = Simulate(options);
  const MapperResult result = Extend(simulation, MapExistingModel(simulation));
  ASSERT_EQ(result.models.size(), 1u);
  EXPECT_NEAR(CompareModels(simulation.scene, result.models[0].reconstruction,
                            simulation.ground_truth)
                  .scale,
              1.0, 0.005);
}

// The existing model has other poses, within the limits of PlaceModel.
TEST(ModelExtension, KnownRigsStayAsTheyAre) {
  SimulationOptions options = NoisyDrive(RigPreset::kStereo);
  options.extrinsics_are_known = true;
  const Simulation simulation = Simulate(options);
  Reconstruction start = MapExistingModel(simulation);
  start.sensor_from_rig[1]->translation *= 1.02;
  const MapperResult result = Extend(simulation, start);
  ASSERT_EQ(result.models.size(), 1u);
  const Rigid3& pose = *result.models[0].reconstruction.sensor_from_rig[1];
  const Rigid3& known = *simulation.scene.sensors[1].sensor_from_rig;
  EXPECT_EQ(pose.translation, known.translation);
  EXPECT_EQ(pose.rotation.coeffs(), known.rotation.coeffs());
}

TEST(ModelExtension, FramesThatCannotBeAddedAreNamed) {
  Simulation simulation = Simulate(NoisyDrive(RigPreset::kStereo));
  const Reconstruction start = MapExistingModel(simulation);
  simulation.view_graph =
      PairsOf(simulation, [](int i) { return i < kNumFrames - 1; });
  std::string warning;
  Context context = TwoThreads();
  context.log = [&](LogLevel level, const std::string& message) {
    if (level == LogLevel::kWarning) warning += message;
  };
  const MapperResult result =
      RunMapper({simulation.scene, simulation.view_graph, {}, {}, start},
                MapperOptions(), context);
  ASSERT_EQ(result.models.size(), 1u);
  ASSERT_EQ(result.unregistered_frames.size(), 1u);
  EXPECT_EQ(result.unregistered_frames[0].frame_idx, kNumFrames - 1);
  EXPECT_THAT(result.unregistered_frames[0].reason,
              HasSubstr("only 0 of its keypoints"));
  EXPECT_THAT(warning, HasSubstr(simulation.scene.frames.back().name));
}

TEST(ModelExtension, FixedFramesExcludePositionPriors) {
  const Simulation simulation = Simulate(NoisyDrive(RigPreset::kMono));
  const Reconstruction start = MapExistingModel(simulation);
  PositionPriors priors;
  priors.images.resize(simulation.scene.images.size());
  EXPECT_THROW((void)RunMapper(
                   {simulation.scene, simulation.view_graph, priors, {}, start},
                   Fixed(), TwoThreads()),
               Error);
}

// Reads files in which the database has other ids than the model.
TEST(ModelExtension, IdsDoNotChangeTheResult) {
  const Simulation simulation = Simulate(NoisyDrive(RigPreset::kStereo));
  const TempDir dir;
  WriteModel(dir.path(), simulation.scene, MapExistingModel(simulation),
             ModelFormat::kBinary);
  DatabaseContents contents =
      MakeDatabaseContents(simulation.scene, simulation.view_graph);
  contents.rigs.clear();
  contents.frames.clear();
  std::vector<Reconstruction> models;
  for (const DatabaseContents& rows : {contents, WithPermutedIds(contents)}) {
    LoadedScene loaded = LoadScene(rows, SceneLoadingOptions(), Context());
    const PlacedModel start = PlaceModel(ReadModel(dir.path()), dir.path(),
                                         "test.db", true, &loaded.scene);
    EXPECT_TRUE(start.is_rigid);
    MapperResult result = RunMapper(
        {loaded.scene, loaded.view_graph, {}, {}, start.reconstruction},
        MapperOptions(), TwoThreads());
    ASSERT_EQ(result.models.size(), 1u);
    models.push_back(std::move(result.models[0].reconstruction));
  }
  EXPECT_LT(MaxPoseDifference(models[0], models[1]), 1e-9);
}

TEST(ModelExtension, AlignmentUndoesASimilarity) {
  const Simulation simulation = Simulate(NoisyDrive(RigPreset::kStereo));
  const Sim3 motion{1.7, ExpSO3({0.3, -0.5, 0.2}), {3.0, -1.0, 2.0}};
  Reconstruction moved = simulation.ground_truth;
  TransformWorld(motion, &moved);
  TransformWorld(
      AlignToModel(simulation.scene, simulation.ground_truth, moved, false),
      &moved);
  EXPECT_LT(MaxPoseDifference(moved, simulation.ground_truth), 1e-9);
}

}  // namespace
}  // namespace mgsfm

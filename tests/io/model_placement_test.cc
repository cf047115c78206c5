// SPDX-License-Identifier: BSD-3-Clause
// Models in the scenes of databases that have more images, under other ids.
#include "models/model_placement.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <functional>

#include "database/database_reader.h"
#include "geometry/so3.h"
#include "io/test_database.h"
#include "mgsfm/models/scene_loading.h"
#include "mgsfm/simulator/simulation.h"
#include "support/partial_model.h"
#include "support/permuted_ids.h"
#include "support/temp_dir.h"

namespace mgsfm {
namespace {

using testing::AllOf;
using testing::HasSubstr;

Simulation SmallDrive() {
  SimulationOptions options;
  options.rig = RigPreset::kKitti360;
  options.num_frames = 6;
  options.num_points_per_frame = 40;
  options.max_num_features_per_image = 30;
  return Simulate(options);
}

// The true model of the first four frames.
Model WrittenPart(const Simulation& simulation) {
  const TempDir dir;
  WriteModel(dir.path(), simulation.scene,
             WithoutFrames(simulation.scene, simulation.ground_truth,
                           [](int i) { return i >= 4; }),
             ModelFormat::kBinary);
  return ReadModel(dir.path());
}

DatabaseContents RowsOf(const Simulation& simulation) {
  DatabaseContents rows =
      MakeDatabaseContents(simulation.scene, simulation.view_graph);
  rows.rigs.clear();
  rows.frames.clear();
  return rows;
}

Scene SceneOf(const DatabaseContents& rows) {
  return LoadScene(rows, SceneLoadingOptions(), Context()).scene;
}

PlacedModel Place(const Model& model, Scene* scene, bool with_points = true) {
  return PlaceModel(model, "folder", "test.db", with_points, scene);
}

void ExpectPosesOfFirstFrames(const Simulation& simulation, const Scene& scene,
                              const Reconstruction& placed) {
  for (size_t i = 0; i < scene.images.size(); ++i) {
    const int idx = static_cast<int>(i);
    const auto pose = placed.CamFromWorld(scene, idx);
    ASSERT_EQ(pose.has_value(), scene.images[i].frame_idx < 4);
    if (!pose) continue;
    const auto truth =
        simulation.ground_truth.CamFromWorld(simulation.scene, idx);
    EXPECT_LT(AngleBetween(pose->rotation, truth->rotation), 1e-12);
    EXPECT_LT((pose->translation - truth->translation).norm(), 1e-12);
  }
}

TEST(ModelPlacing, PosesAndPointsAreThoseOfTheModel) {
  const Simulation simulation = SmallDrive();
  const Model model = WrittenPart(simulation);
  for (const DatabaseContents& rows :
       {RowsOf(simulation), WithPermutedIds(RowsOf(simulation))}) {
    Scene scene = SceneOf(rows);
    for (Camera& camera : scene.cameras) camera.params[0] *= 1.1;
    const PlacedModel placed = Place(model, &scene);
    EXPECT_TRUE(placed.is_rigid);
    ExpectPosesOfFirstFrames(simulation, scene, placed.reconstruction);
    EXPECT_EQ(placed.reconstruction.points.size(), model.points.size());
    for (size_t i = 0; i < scene.cameras.size(); ++i) {
      EXPECT_EQ(scene.cameras[i].params, simulation.scene.cameras[i].params);
      EXPECT_TRUE(scene.cameras[i].has_prior_focal_length);
    }
  }
}

TEST(ModelPlacing, ModelsWithoutTablesWillDo) {
  const Simulation simulation = SmallDrive();
  Model model = WrittenPart(simulation);
  model.poses.rigs.clear();
  model.poses.frames.clear();
  Scene scene = SceneOf(RowsOf(simulation));
  const PlacedModel placed = Place(model, &scene);
  EXPECT_TRUE(placed.is_rigid);
  ExpectPosesOfFirstFrames(simulation, scene, placed.reconstruction);
  // Images that were estimated by themselves.
  model.poses.images[5].cam_from_world.translation.x() += 0.01;
  EXPECT_FALSE(Place(model, &scene).is_rigid);
}

// A reference sensor without images does not define the pose of the rig.
TEST(ModelPlacing, AnotherReferenceTakesThePlaceOfOneWithoutImages) {
  const Simulation simulation = SmallDrive();
  Model model = WrittenPart(simulation);
  model.poses.rigs.clear();
  model.poses.frames.clear();
  auto& images = model.poses.images;
  images.erase(std::remove_if(images.begin(), images.end(),
                              [](const ModelImage& image) {
                                return image.name.substr(0, 4) == "cam0";
                              }),
               images.end());
  Scene scene = SceneOf(RowsOf(simulation));
  const PlacedModel placed = Place(model, &scene, false);
  CheckConsistent(scene);
  EXPECT_NE(scene.rigs[0].ref_sensor_idx, 0);
  EXPECT_FALSE(placed.reconstruction.sensor_from_rig[0].has_value());
  for (size_t i = 0; i < scene.images.size(); ++i) {
    EXPECT_EQ(placed.reconstruction.IsRegistered(scene, static_cast<int>(i)),
              scene.images[i].frame_idx < 4 && scene.images[i].sensor_idx != 0);
  }
}

TEST(ModelPlacing, WhatDoesNotBelongTogetherIsRefused) {
  const Simulation simulation = SmallDrive();
  const Model good = WrittenPart(simulation);
  const auto expect_refused =
      [&](const std::function<void(Model*, DatabaseContents*)>& change,
          const testing::Matcher<std::string>& message) {
        Model model = good;
        DatabaseContents rows = RowsOf(simulation);
        change(&model, &rows);
        Scene scene = SceneOf(rows);
        EXPECT_THAT(ErrorOf([&] { (void)Place(model, &scene); }),
                    AllOf(HasSubstr("model 'folder'"), message));
      };
  expect_refused([](Model* model, auto*) { *model = Model(); },
                 HasSubstr("it has no image"));
  expect_refused([](Model* model,
                    auto*) { model->poses.images[2].name = "cam0/other.png"; },
                 AllOf(HasSubstr("'cam0/other.png'"), HasSubstr("'test.db'"),
                       HasSubstr("extract and match")));
  expect_refused(
      [](Model* model, auto*) {
        for (ModelImage& image : model->poses.images) image.name += "x";
      },
      AllOf(HasSubstr("none of its images"), HasSubstr("give the database")));
  expect_refused(
      [](Model* model, auto*) { model->cameras[0].width_px += 1; },
      AllOf(HasSubstr("'cam0/000000.png'"), HasSubstr("px, in the database")));
  expect_refused(
      [](auto*, DatabaseContents* rows) {
        FindImage(rows, "cam1/000001.png").keypoints_px[0].x() += 2.0f;
        FindImage(rows, "cam1/000001.png").keypoints_px.resize(1);
        rows->pairs.clear();
      },
      AllOf(HasSubstr("'cam1/000001.png'"), HasSubstr("point_triangulator")));
  expect_refused(
      [](Model* model, auto*) { model->points.clear(); },
      AllOf(HasSubstr("no points"), HasSubstr("point_triangulator")));
  expect_refused(
      [](auto*, DatabaseContents* rows) {
        for (ImageRow& image : rows->images) {
          if (image.name.substr(0, 4) == "cam1") image.name.insert(5, "late");
        }
      },
      HasSubstr("is not in the database"));
}

TEST(ModelPlacing, FramesOfTheModelMustBeFramesOfTheScene) {
  const Simulation simulation = SmallDrive();
  SceneLoadingOptions single;
  single.rig_name_rule = "none";
  Scene scene = LoadScene(RowsOf(simulation), single, Context()).scene;
  EXPECT_THAT(
      ErrorOf([&] { (void)Place(WrittenPart(simulation), &scene); }),
      AllOf(HasSubstr("belong to one frame"), HasSubstr("rig_config_path")));
}

TEST(ModelPlacing, GivenRigsMustBeThatOfTheModel) {
  const Simulation simulation = SmallDrive();
  for (const double factor : {1.001, 2.0}) {
    Scene scene = SceneOf(RowsOf(simulation));
    for (size_t i = 1; i < scene.sensors.size(); ++i) {
      scene.sensors[i].sensor_from_rig =
          simulation.ground_truth.sensor_from_rig[i];
      scene.sensors[i].sensor_from_rig->translation *= factor;
    }
    const std::string message =
        ErrorOf([&] { (void)Place(WrittenPart(simulation), &scene); });
    if (factor < 1.01) {
      EXPECT_EQ(message, "no error");
    } else {
      EXPECT_THAT(message,
                  AllOf(HasSubstr("camera 'cam"), HasSubstr("omit the pose")));
    }
  }
}

TEST(ImageList, LeavesOthersOut) {
  const Simulation simulation = SmallDrive();
  DatabaseContents rows =
      MakeDatabaseContents(simulation.scene, simulation.view_graph);
  const TempDir dir;
  const std::string path = (dir.path() / "list.txt").string();
  WriteTextFile(path, "cam0/000000.png\n\ncam1/000000.png \ncam0/000001.png\n");
  const std::vector<std::string> names = ReadImageList(path);
  ASSERT_EQ(names.size(), 3u);
  KeepListedImages({names.begin(), names.end()}, path, &rows);
  EXPECT_EQ(rows.images.size(), 3u);
  EXPECT_EQ(rows.frames.size(), 2u);
  const LoadedScene loaded = LoadScene(rows, SceneLoadingOptions(), Context());
  CheckConsistent(loaded.scene);
  EXPECT_EQ(loaded.scene.images.size(), 3u);
  EXPECT_LE(loaded.view_graph.pairs.size(), 3u);
  EXPECT_GE(loaded.view_graph.pairs.size(), 1u);
}

TEST(ImageList, UnknownNamesAndEmptyListsAreErrors) {
  DatabaseContents rows = RowsOf(SmallDrive());
  EXPECT_THAT(ErrorOf([&] { KeepListedImages({}, "list", &rows); }),
              HasSubstr("lists no image"));
  EXPECT_THAT(ErrorOf([&] { KeepListedImages({"a.png"}, "list", &rows); }),
              AllOf(HasSubstr("'list'"), HasSubstr("'a.png'")));
  EXPECT_THAT(ErrorOf([&] { (void)ReadImageList("/none/list"); }),
              HasSubstr("/none/list"));
}

}  // namespace
}  // namespace mgsfm

// SPDX-License-Identifier: BSD-3-Clause
// Conversion of a model to the scene and reconstruction that it was written
// from.
#include "mgsfm/models/model_scene.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "base/random.h"
#include "geometry/so3.h"
#include "io/test_database.h"
#include "mgsfm/rigs/rig_config.h"
#include "mgsfm/simulator/simulation.h"
#include "support/temp_dir.h"

namespace mgsfm {
namespace {

using testing::AllOf;
using testing::HasSubstr;

Simulation SmallDrive(double missing_image_ratio = 0.0) {
  SimulationOptions options;
  options.rig = RigPreset::kKitti360;
  options.num_frames = 6;
  options.num_points_per_frame = 40;
  options.max_num_features_per_image = 30;
  options.missing_image_ratio = missing_image_ratio;
  return Simulate(options);
}

Model Written(const Simulation& simulation) {
  const TempDir dir;
  WriteModel(dir.path(), simulation.scene, simulation.ground_truth,
             ModelFormat::kBinary);
  return ReadModel(dir.path());
}

// The model of COLMAP 3.8.
Model WithoutTables(Model model) {
  model.poses.rigs.clear();
  model.poses.frames.clear();
  return model;
}

ModelScene Load(const Model& model, const std::string& rig_name_rule = "auto") {
  SceneLoadingOptions options;
  options.rig_name_rule = rig_name_rule;
  return MakeModelScene(model, "folder", options, Context());
}

std::string ErrorOfLoading(const Model& model) {
  return ErrorOf([&] { (void)Load(model); });
}

void ExpectSamePose(const Rigid3& a, const Rigid3& b) {
  EXPECT_LT(AngleBetween(a.rotation, b.rotation), 1e-7);
  EXPECT_LT((a.translation - b.translation).norm(), 1e-9);
}

void ExpectSamePoses(const ModelScene& loaded, const Simulation& simulation) {
  const Reconstruction& truth = simulation.ground_truth;
  ASSERT_EQ(loaded.scene.sensors.size(), truth.sensor_from_rig.size());
  ASSERT_EQ(loaded.scene.frames.size(), truth.rig_from_world.size());
  for (size_t i = 0; i < truth.sensor_from_rig.size(); ++i) {
    ExpectSamePose(*loaded.reconstruction.sensor_from_rig[i],
                   *truth.sensor_from_rig[i]);
  }
  for (size_t i = 0; i < truth.rig_from_world.size(); ++i) {
    ExpectSamePose(*loaded.reconstruction.rig_from_world[i],
                   *truth.rig_from_world[i]);
  }
}

TEST(ModelSceneTest, HoldsWhatWasWritten) {
  const Simulation simulation = SmallDrive(0.2);
  const ModelScene loaded = Load(Written(simulation));
  CheckConsistent(loaded.scene);
  EXPECT_THAT(loaded.rig_source, HasSubstr("of the model"));
  ExpectSamePoses(loaded, simulation);
  ASSERT_EQ(loaded.scene.images.size(), simulation.scene.images.size());
  for (size_t i = 0; i < loaded.scene.images.size(); ++i) {
    const Image& image = simulation.scene.images[i];
    EXPECT_EQ(loaded.scene.images[i].name, image.name);
    EXPECT_EQ(loaded.scene.images[i].keypoints_px, image.keypoints_px);
    EXPECT_EQ(loaded.scene.images[i].frame_idx, image.frame_idx);
    EXPECT_EQ(loaded.scene.images[i].sensor_idx, image.sensor_idx);
  }
  const auto& points = simulation.ground_truth.points;
  ASSERT_EQ(loaded.reconstruction.points.size(), points.size());
  for (size_t i = 0; i < points.size(); ++i) {
    EXPECT_EQ(loaded.reconstruction.points[i].point_in_world,
              points[i].point_in_world);
    EXPECT_EQ(loaded.reconstruction.points[i].track, points[i].track);
  }
}

// A model is an estimate, but for intrinsics, of which it says nothing.
TEST(ModelSceneTest, IntrinsicsAreKnownAndPosesInTheRigAreNot) {
  const ModelScene loaded = Load(Written(SmallDrive()));
  for (const Camera& camera : loaded.scene.cameras) {
    EXPECT_TRUE(camera.has_prior_focal_length);
  }
  for (size_t i = 0; i < loaded.scene.sensors.size(); ++i) {
    EXPECT_EQ(loaded.scene.sensors[i].sensor_from_rig.has_value(),
              loaded.scene.IsReference(static_cast<int>(i)));
  }
}

TEST(ModelSceneTest, RigConfigurationGivesKnownPoses) {
  const Simulation simulation = SmallDrive();
  const TempDir dir;
  const std::string path = (dir.path() / "rig_config.json").string();
  WriteRigConfig(path, simulation.scene, simulation.ground_truth);
  SceneLoadingOptions options;
  options.rig_config_path = path;
  const ModelScene loaded =
      MakeModelScene(Written(simulation), "folder", options, Context());
  for (const Sensor& sensor : loaded.scene.sensors) {
    EXPECT_TRUE(sensor.sensor_from_rig.has_value());
  }
  ExpectSamePoses(loaded, simulation);
}

TEST(ModelSceneTest, ModelsWithoutTablesGetRigsFromNames) {
  const Simulation simulation = SmallDrive(0.3);
  const ModelScene loaded = Load(WithoutTables(Written(simulation)));
  EXPECT_EQ(loaded.rig_source, "image names");
  EXPECT_EQ(loaded.scene.rigs.size(), 1u);
  for (size_t i = 0; i < simulation.scene.images.size(); ++i) {
    const int idx = static_cast<int>(i);
    const auto pose = loaded.reconstruction.CamFromWorld(loaded.scene, idx);
    ASSERT_TRUE(pose.has_value());
    ExpectSamePose(
        *pose, *simulation.ground_truth.CamFromWorld(simulation.scene, idx));
  }
}

// COLMAP 3.8 places images one by one, and some of them wrongly.
TEST(ModelSceneTest, FewWrongImagesDoNotMoveTheRig) {
  const Simulation simulation = SmallDrive();
  Model model = WithoutTables(Written(simulation));
  for (size_t i = 0; i < model.poses.images.size(); ++i) {
    ModelImage& image = model.poses.images[i];
    if (image.name.find("000002") == std::string::npos) continue;
    image.cam_from_world =
        Rigid3{ExpSO3({0.1, 0.3 + 0.1 * static_cast<double>(i), 0.0}),
               {1.0, 2.0, 0.1 * static_cast<double>(i)}} *
        image.cam_from_world;
  }
  const ModelScene loaded = Load(model);
  for (size_t i = 0; i < loaded.scene.sensors.size(); ++i) {
    ExpectSamePose(*loaded.reconstruction.sensor_from_rig[i],
                   *simulation.ground_truth.sensor_from_rig[i]);
  }
}

// Rigs of a model are never dropped without a word.
TEST(ModelSceneTest, TablesThatLeaveOutImagesAreNamed) {
  Model model = Written(SmallDrive());
  const std::vector<ImageId> left_out = model.poses.frames.back().image_ids;
  model.poses.frames.pop_back();
  EXPECT_THAT(ErrorOfLoading(model),
              AllOf(HasSubstr(std::to_string(left_out.size()) + " of its"),
                    HasSubstr("000005"), HasSubstr("rig_name_rule none")));
  model.poses.frames.clear();
  EXPECT_THAT(ErrorOfLoading(model), HasSubstr("in no frame"));
  EXPECT_EQ(Load(model, "none").scene.frames.size(), model.poses.images.size());
  EXPECT_EQ(Load(WithoutTables(model)).rig_source, "image names");
}

TEST(ModelSceneTest, TablesOfTheOtherFormatAreNamed) {
  const Simulation simulation = SmallDrive();
  for (const auto& [format, other, stem] :
       {std::make_tuple(ModelFormat::kBinary, ModelFormat::kText, "rigs.txt"),
        std::make_tuple(ModelFormat::kText, ModelFormat::kBinary,
                        "frames.bin")}) {
    const TempDir dir, other_dir;
    WriteModel(dir.path(), simulation.scene, simulation.ground_truth, format);
    WriteModel(other_dir.path(), simulation.scene, simulation.ground_truth,
               other);
    const std::string name = stem;
    const std::string extension =
        format == ModelFormat::kBinary ? ".bin" : ".txt";
    std::filesystem::remove(dir.path() /
                            (name.substr(0, name.find('.')) + extension));
    std::filesystem::copy(other_dir.path() / name, dir.path() / name);
    EXPECT_THAT(ErrorOf([&] { (void)ReadModel(dir.path()); }),
                AllOf(HasSubstr("images" + extension), HasSubstr(name)));
  }
}

// A given rig must be that of the images, which it would move otherwise.
TEST(ModelSceneTest, KnownPosesThatContradictImagesAreNamed) {
  const Simulation simulation = SmallDrive();
  const Model model = Written(simulation);
  const TempDir dir;
  SceneLoadingOptions options;
  options.rig_config_path = (dir.path() / "rig_config.json").string();
  const auto error_of = [&](const Rigid3& error, int sensor_idx) {
    Reconstruction changed = simulation.ground_truth;
    auto& pose = changed.sensor_from_rig[sensor_idx];
    pose = error * *pose;
    WriteRigConfig(*options.rig_config_path, simulation.scene, changed);
    return ErrorOf(
        [&] { (void)MakeModelScene(model, "folder", options, Context()); });
  };
  double size = 0.0;
  int sensor_idx = -1;
  for (size_t i = 0; i < simulation.scene.sensors.size(); ++i) {
    const auto& pose = *simulation.ground_truth.sensor_from_rig[i];
    size = std::max(size, pose.translation.norm());
    if (!simulation.scene.IsReference(static_cast<int>(i))) {
      sensor_idx = static_cast<int>(i);
    }
  }
  const Eigen::Vector3d axis = Eigen::Vector3d(1.0, -2.0, 3.0).normalized();
  const auto turned_by = [&](double angle_deg) {
    return Rigid3{ExpSO3(DegToRad(angle_deg) * axis), {0.0, 0.0, 0.0}};
  };
  const auto shifted_by = [&](double shift) {
    return Rigid3{Eigen::Quaterniond::Identity(), shift * size * axis};
  };
  EXPECT_EQ(error_of(turned_by(0.5), sensor_idx), "no error");
  EXPECT_EQ(error_of(shifted_by(0.03), sensor_idx), "no error");
  const std::string& name = simulation.scene.sensors[sensor_idx].name;
  EXPECT_THAT(error_of(turned_by(2.0), sensor_idx),
              AllOf(HasSubstr("'" + name + "'"), HasSubstr("2.00 deg")));
  EXPECT_THAT(error_of(shifted_by(0.1), sensor_idx), HasSubstr("shift"));
}

TEST(ModelSceneTest, FramesMayNameImagesThatTheModelLacks) {
  const Simulation simulation = SmallDrive();
  Model model = Written(simulation);
  model.poses.frames[0].image_ids.emplace_back(999);
  ExpectSamePoses(Load(model), simulation);
}

TEST(ModelSceneTest, SingleImagesOnRequest) {
  const ModelScene loaded = Load(Written(SmallDrive()), "none");
  EXPECT_EQ(loaded.scene.frames.size(), loaded.scene.images.size());
  EXPECT_EQ(loaded.scene.rigs.size(), loaded.scene.cameras.size());
}

TEST(ModelSceneTest, EmptyModelIsAnError) {
  EXPECT_THAT(ErrorOfLoading(Model()), HasSubstr("model 'folder': it has no"));
}

TEST(ModelSceneTest, ImageThatContradictsItsFrameIsNamed) {
  Model model = Written(SmallDrive());
  model.poses.images[7].cam_from_world.translation.x() += 0.1;
  EXPECT_THAT(ErrorOfLoading(model),
              AllOf(HasSubstr("model 'folder'"),
                    HasSubstr("'" + model.poses.images[7].name + "'"),
                    HasSubstr("rig_name_rule")));
}

TEST(ModelSceneTest, ACameraBelongsToOneRig) {
  Model model = Written(SmallDrive());
  const CameraId camera_id = model.poses.images[0].camera_id;
  model.poses.rigs.push_back({RigId(99), camera_id, {{camera_id, Rigid3()}}});
  EXPECT_THAT(ErrorOfLoading(model),
              AllOf(HasSubstr("model 'folder'"), HasSubstr("rig 99")));
}

TEST(ModelSceneTest, ImagesOfOneNameThatDoNotMoveTogetherAreNoRig) {
  Model model = WithoutTables(Written(SmallDrive()));
  Random random(2);
  for (ModelImage& image : model.poses.images) {
    image.cam_from_world.rotation =
        ExpSO3({random.Normal(), random.Normal(), random.Normal()});
  }
  EXPECT_THAT(ErrorOfLoading(model),
              AllOf(HasSubstr("'cam1'"), HasSubstr("rig_name_rule none")));
  EXPECT_EQ(Load(model, "none").scene.frames.size(), model.poses.images.size());
}

TEST(ModelSceneTest, SensorThatNothingPlacesIsNamed) {
  const Simulation simulation = SmallDrive();
  const TempDir dir;
  const std::string path = (dir.path() / "rig_config.json").string();
  std::vector<RigConfig> rigs(1);
  for (const char* prefix : {"cam0/", "cam1/", "cam2/", "cam3/"}) {
    rigs[0].cameras.push_back({prefix, rigs[0].cameras.empty(), {}, {}, {}});
  }
  WriteRigConfig(path, rigs);
  Model model = Written(simulation);
  // cam3 took its images at other instants than all others.
  for (ModelImage& image : model.poses.images) {
    if (image.name.substr(0, 5) == "cam3/") image.name.insert(5, "late");
  }
  SceneLoadingOptions options;
  options.rig_config_path = path;
  EXPECT_THAT(ErrorOf([&] {
                (void)MakeModelScene(model, "folder", options, Context());
              }),
              AllOf(HasSubstr("'cam3'"), HasSubstr("rig_config_path")));
}

// The keypoints of the points tell how the poses are meant.
TEST(ModelSceneTest, OtherConventionsOfPosesAreNamed) {
  const Model model = Written(SmallDrive());
  const auto changed = [&](bool is_xyzw, bool is_world_from_cam) {
    Model copy = model;
    for (ModelImage& image : copy.poses.images) {
      Rigid3& pose = image.cam_from_world;
      if (is_world_from_cam) pose = pose.Inverse();
      const Eigen::Quaterniond q = pose.rotation;
      if (is_xyzw) pose.rotation = {q.x(), q.y(), q.z(), q.w()};
    }
    return ErrorOfLoading(copy);
  };
  EXPECT_EQ(changed(false, false), "no error");
  EXPECT_THAT(changed(true, false), HasSubstr("write them as w x y z"));
  EXPECT_THAT(changed(false, true), HasSubstr("write their inverses"));
  EXPECT_THAT(changed(true, true),
              AllOf(HasSubstr("inverses"), HasSubstr("w x y z")));
}

TEST(ModelSceneTest, IntrinsicsThatNoLensHasAreRefused) {
  Model model = Written(SmallDrive());
  for (const int i : InfoOf(model.cameras[0].model).focal_length_idxs) {
    model.cameras[0].params[i] = 50.0 * model.cameras[0].width_px;
  }
  EXPECT_THAT(ErrorOfLoading(model),
              AllOf(HasSubstr("model 'folder'"), HasSubstr("50 times")));
}

}  // namespace
}  // namespace mgsfm

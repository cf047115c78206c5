// SPDX-License-Identifier: BSD-3-Clause
#include "mgsfm/rigs/rig_config.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "io/test_database.h"
#include "mgsfm/models/model_io.h"
#include "mgsfm/models/scene_loading.h"
#include "support/error_of.h"
#include "support/temp_dir.h"

namespace mgsfm {
namespace {

using testing::HasSubstr;

class RigConfigTest : public testing::Test {
 protected:
  std::string Path() const { return (dir_.path() / "rig.json").string(); }
  std::vector<RigConfig> Parse(const std::string& text) const {
    WriteTextFile(Path(), text);
    return ReadRigConfig(Path());
  }
  LoadedScene Load(const std::vector<std::string>& names) const {
    SceneLoadingOptions options;
    options.rig_config_path = Path();
    return LoadScene(MakeContents(names), options, Context());
  }

  TempDir dir_;
};

TEST_F(RigConfigTest, ReadsAllKeys) {
  const std::vector<RigConfig> rigs = Parse(R"([
    {"cameras": [
      {"image_prefix": "a/", "ref_sensor": true},
      {"image_prefix": "b/", "ref_sensor": false,
       "cam_from_rig_rotation": [0, 0.9996, 0, 0],
       "cam_from_rig_translation": [1, 2.5, -3],
       "camera_model_name": "PINHOLE", "camera_params": [1, 2, 3, 4]},
      {"image_prefix": "c/"}]},
    {"cameras": [{"image_prefix": "d_", "ref_sensor": true}]}])");
  ASSERT_EQ(rigs.size(), 2u);
  ASSERT_EQ(rigs[0].cameras.size(), 3u);
  EXPECT_TRUE(rigs[0].cameras[0].is_reference);
  EXPECT_TRUE(rigs[0].cameras[0].cam_from_rig.has_value());
  const RigConfigCamera& b = rigs[0].cameras[1];
  EXPECT_EQ(b.image_prefix, "b/");
  EXPECT_FALSE(b.is_reference);
  EXPECT_EQ(b.cam_from_rig->rotation.coeffs(), Eigen::Vector4d(1, 0, 0, 0));
  EXPECT_EQ(b.cam_from_rig->translation, Eigen::Vector3d(1, 2.5, -3));
  EXPECT_EQ(b.camera_model, CameraModelId::kPinhole);
  EXPECT_EQ(b.camera_params, (std::vector<double>{1, 2, 3, 4}));
  EXPECT_FALSE(rigs[0].cameras[2].cam_from_rig.has_value());
  EXPECT_EQ(rigs[1].cameras[0].image_prefix, "d_");
}

TEST_F(RigConfigTest, NamesWhatIsWrong) {
  const auto rig = [](const std::string& camera) {
    return R"([{"cameras": [{"image_prefix": "a/", "ref_sensor": true}, {)" +
           camera + "}]}]";
  };
  const std::vector<std::pair<std::string, std::string>> cases = {
      {"[", "not valid JSON"},
      {"{}", "not an array"},
      {"[]", "not an array"},
      {"[3]", "rig 1 is not an object"},
      {R"([{"cameras": []}])", "rig 1 needs 'cameras'"},
      {R"([{"cameras": [{"image_prefix": "a"}], "name": 1}])", "'name'"},
      {R"([{"cameras": [{"image_prefix": "a"}]}])", "has 0 cameras with"},
      {rig(R"("image_prefix": "b/", "ref_sensor": true)"), "has 2 cameras"},
      {rig(R"("prefix": "b/")"), "camera 2 of rig 1 has the unknown key"},
      {rig(R"("image_prefix": "b", "image_prefix": "c")"), "twice"},
      {rig(R"("ref_sensor": false)"), "needs 'image_prefix'"},
      {rig(R"("image_prefix": "b", "ref_sensor": 1)"), "true or false"},
      {rig(R"("image_prefix": "b", "cam_from_rig_rotation": [1, 0, 0, 0])"),
       "only one of"},
      {rig(R"("image_prefix": "b", "cam_from_rig_rotation": [1, 0, 0],
              "cam_from_rig_translation": [0, 0, 0])"),
       "array of 4 numbers"},
      {rig(R"("image_prefix": "b", "cam_from_rig_rotation": [0, 0, 0, 0],
              "cam_from_rig_translation": [0, 0, 0])"),
       "length 0 in place of 1"},
      {rig(R"("image_prefix": "b", "cam_from_rig_rotation": [0, 2, 0, 0],
              "cam_from_rig_translation": [0, 0, 0])"),
       "length 2 in place of 1"},
      {rig(R"("image_prefix": "b", "camera_model_name": "PINHOLE",
              "camera_params": [1, 2, 3])"),
       "array of 4 numbers"},
      {rig(R"("image_prefix": "b", "camera_model_name": "NONE",
              "camera_params": [1, 2, 3])"),
       "unknown camera model 'NONE'"},
      {R"([{"cameras": [{"image_prefix": "a", "ref_sensor": true,
            "cam_from_rig_rotation": [1, 0, 0, 0],
            "cam_from_rig_translation": [0, 0, 0]}]}])",
       "must not have a pose"}};
  for (const auto& [text, expected] : cases) {
    const std::string error = ErrorOf([&, &text = text] { (void)Parse(text); });
    EXPECT_THAT(error, HasSubstr(expected)) << text;
    EXPECT_THAT(error, HasSubstr(Path())) << text;
  }
  EXPECT_THAT(ErrorOf([] { (void)ReadRigConfig("/no/such.json"); }),
              HasSubstr("cannot be read"));
}

TEST_F(RigConfigTest, WhatIsWrittenIsReadBack) {
  RigConfig rig;
  rig.cameras.resize(3);
  rig.cameras[0].image_prefix = "a/";
  rig.cameras[0].is_reference = true;
  rig.cameras[1].image_prefix = "b \"quoted\"/";
  rig.cameras[1].cam_from_rig =
      Rigid3{ExpSO3({0.1, 0.2, 0.3}), Eigen::Vector3d(1.0 / 3.0, 2.0, 3e-17)};
  rig.cameras[1].camera_model = CameraModelId::kSimplePinhole;
  rig.cameras[1].camera_params = {0.1, 0.2, 0.3};
  rig.cameras[2].image_prefix = "c/";
  WriteRigConfig(Path(), {rig, rig});
  const std::vector<RigConfig> read = ReadRigConfig(Path());
  ASSERT_EQ(read.size(), 2u);
  for (size_t i = 0; i < 3; ++i) {
    const RigConfigCamera& a = read[1].cameras[i];
    const RigConfigCamera& b = rig.cameras[i];
    EXPECT_EQ(a.image_prefix, b.image_prefix);
    EXPECT_EQ(a.is_reference, b.is_reference);
    EXPECT_EQ(a.camera_model, b.camera_model);
    EXPECT_EQ(a.camera_params, b.camera_params);
  }
  EXPECT_LT(AngleBetween(read[0].cameras[1].cam_from_rig->rotation,
                         rig.cameras[1].cam_from_rig->rotation),
            1e-15);
  EXPECT_EQ(read[0].cameras[1].cam_from_rig->translation,
            rig.cameras[1].cam_from_rig->translation);
  EXPECT_FALSE(read[0].cameras[2].cam_from_rig.has_value());
  EXPECT_THROW(WriteRigConfig("/no/such/folder/rig.json", {rig}), Error);
}

// A model in which sensor i has the pose of turning and moving by i.
Reconstruction MakeModel(const Scene& scene) {
  Reconstruction model;
  model.cameras = scene.cameras;
  for (size_t i = 0; i < scene.sensors.size(); ++i) {
    const double x = static_cast<double>(i);
    model.sensor_from_rig.push_back(scene.IsReference(static_cast<int>(i))
                                        ? Rigid3()
                                        : Rigid3{ExpSO3({0.1 * x, 0.0, 0.2}),
                                                 Eigen::Vector3d(x, 1.0, 0.0)});
  }
  model.rig_from_world.resize(scene.frames.size());
  return model;
}

void ExpectSameRigs(const Scene& a, const Scene& b) {
  ASSERT_EQ(a.images.size(), b.images.size());
  ASSERT_EQ(a.sensors.size(), b.sensors.size());
  ASSERT_EQ(a.frames.size(), b.frames.size());
  ASSERT_EQ(a.rigs.size(), b.rigs.size());
  for (size_t i = 0; i < a.images.size(); ++i) {
    EXPECT_EQ(a.images[i].sensor_idx, b.images[i].sensor_idx);
    EXPECT_EQ(a.images[i].frame_idx, b.images[i].frame_idx);
  }
  for (size_t i = 0; i < a.rigs.size(); ++i) {
    EXPECT_EQ(a.rigs[i].ref_sensor_idx, b.rigs[i].ref_sensor_idx);
    EXPECT_EQ(a.rigs[i].sensor_idxs, b.rigs[i].sensor_idxs);
  }
}

TEST_F(RigConfigTest, CalibratedRigsAreReadBack) {
  const std::vector<std::string> names = {
      "one/cam0/0.png", "one/cam1/0.png", "one/cam2/0.png", "one/cam2/1.png",
      "one/cam1/1.png", "two/left/0.png", "two/right/0.png"};
  const LoadedScene from_names =
      LoadScene(MakeContents(names),
                LoadingBy("(?<rig>[^/]+)/(?<camera>[^/]+)/.*"), Context());
  Reconstruction model = MakeModel(from_names.scene);
  model.cameras[0].params[0] = 123.0;
  model.sensor_from_rig[2].reset();
  WriteRigConfig(Path(), from_names.scene, model);
  const LoadedScene from_config = Load(names);
  ExpectSameRigs(from_config.scene, from_names.scene);
  const auto camera0 = from_config.scene.sensors[0].camera_idx;
  EXPECT_EQ(from_config.scene.cameras[camera0].params[0], 123.0);
  for (size_t i = 0; i < model.sensor_from_rig.size(); ++i) {
    const auto& pose = from_config.scene.sensors[i].sensor_from_rig;
    ASSERT_EQ(pose.has_value(), model.sensor_from_rig[i].has_value());
    if (!pose) continue;
    EXPECT_LT(AngleBetween(pose->rotation, model.sensor_from_rig[i]->rotation),
              1e-12);
    EXPECT_LT(
        (pose->translation - model.sensor_from_rig[i]->translation).norm(),
        1e-12);
  }
}

// Names of one frame differ; times form the frames of the next recording, too.
TEST_F(RigConfigTest, RigsWithFramesByTimeAreReadBack) {
  const std::vector<std::string> names = {
      "cam0/1700000000000001000.png", "cam0/1700000000100001000.png",
      "cam1/1700000000000004000.png", "cam1/1700000000100003000.png"};
  SceneLoadingOptions options;
  options.frame_max_time_difference_s = 0.001;
  const Scene scene = LoadScene(MakeContents(names), options, Context()).scene;
  ASSERT_EQ(scene.frames.size(), 2u);
  const Reconstruction model = MakeModel(scene);
  WriteRigConfig(Path(), scene, model);
  ASSERT_EQ(ReadRigConfig(Path()).size(), 1u);
  options.rig_config_path = Path();
  const Scene loaded = LoadScene(MakeContents(names), options, Context()).scene;
  ExpectSameRigs(loaded, scene);
  EXPECT_LT((loaded.sensors[1].sensor_from_rig->translation -
             model.sensor_from_rig[1]->translation)
                .norm(),
            1e-12);
}

// An image is at rel * rig in COLMAP 3.8, so that only differences between the
// poses of cameras matter.
TEST_F(RigConfigTest, LegacyConfigurationsOfRigBundleAdjuster) {
  const auto parse = [&](const std::string& ref, const std::string& pose) {
    return Parse(R"([{"ref_camera_id": )" + ref +
                 R"(, "cameras": [{"camera_id": 4, "image_prefix": "a/",
                      "rel_qvec": [0, 1, 0, 0], "rel_tvec": [1, 2, 3]},
                     {"camera_id": 7, "image_prefix": "b/")" +
                 pose + "}]}]");
  };
  const RigConfig rig =
      parse("7", R"(, "rel_qvec": [1, 0, 0, 0], "rel_tvec": [0, 1, 0])")[0];
  EXPECT_TRUE(rig.cameras[1].is_reference);
  // a_from_b: y and z change their signs.
  const Rigid3& pose = *rig.cameras[0].cam_from_rig;
  EXPECT_LT(
      (pose * Eigen::Vector3d(5, 6, 7) - Eigen::Vector3d(6, -3, -4)).norm(),
      1e-12);
  EXPECT_FALSE(parse("7", "")[0].cameras[0].cam_from_rig.has_value());
  EXPECT_THAT(ErrorOf([&] { parse("5", ""); }), HasSubstr("ref_camera_id"));
  EXPECT_THAT(
      ErrorOf([&] {
        parse("7", R"(, "rel_qvec": [1, 0, 0, 0], "rel_tvec": [-1e15, 0, 0])");
      }),
      HasSubstr("has a pose that"));
  EXPECT_THAT(ErrorOf([&] { parse("7", R"(, "ref_sensor": true)"); }),
              HasSubstr("unknown key 'ref_sensor'"));
}

// A folder with a model stands for the calibration in it, with and without the
// file beside it, which COLMAP does not write.
TEST_F(RigConfigTest, ModelIsReadLikeItsConfig) {
  const std::vector<std::string> names = {
      "cam0/0.png", "cam0/1.png", "cam1/0.png", "cam1/1.png", "cam2/1.png"};
  const Scene scene = LoadScene(MakeContents(names), {}, Context()).scene;
  Reconstruction model = MakeModel(scene);
  for (auto& pose : model.rig_from_world) pose = Rigid3();
  const std::filesystem::path folder = dir_.path() / "model";
  std::filesystem::create_directory(folder);
  WriteModel(folder, scene, model, ModelFormat::kBinary);
  const auto read = [&](const std::filesystem::path& path) {
    SceneLoadingOptions options;
    options.rig_config_path = path.string();
    return LoadScene(MakeContents(names), options, Context()).scene;
  };
  const auto expect_poses = [&](const Scene& loaded) {
    ExpectSameRigs(loaded, scene);
    for (size_t i = 0; i < scene.sensors.size(); ++i) {
      const Rigid3& pose = *loaded.sensors[i].sensor_from_rig;
      const Rigid3& expected = *model.sensor_from_rig[i];
      EXPECT_LT(AngleBetween(pose.rotation, expected.rotation), 1e-12);
      EXPECT_LT((pose.translation - expected.translation).norm(), 1e-12);
    }
  };
  expect_poses(read(folder));
  const std::filesystem::path config = folder / "rig_config.json";
  WriteRigConfig(config.string(), scene, model);
  expect_poses(read(folder));
  // A configuration that contradicts the model beside it counts only by name.
  model.sensor_from_rig[1]->translation.x() = 7.0;
  WriteRigConfig(config.string(), scene, model);
  EXPECT_NE(ErrorOf([&] { read(folder); }).find("contradicts the model"),
            std::string::npos);
  expect_poses(read(config));
}

TEST_F(RigConfigTest, OneRigInTwoFoldersIsWrittenTwice) {
  // The reference, cam0, has no image in the second folder.
  const std::vector<std::string> names = {"seqA/cam0/0.png", "seqA/cam1/0.png",
                                          "seqA/cam2/0.png", "seqB/cam1/0.png",
                                          "seqB/cam2/0.png", "seqA/cam0/1.png",
                                          "seqA/cam0/2.png"};
  const Scene scene = LoadScene(MakeContents(names), {}, Context()).scene;
  ASSERT_EQ(scene.rigs.size(), 1u);
  const Reconstruction model = MakeModel(scene);
  WriteRigConfig(Path(), scene, model);
  const std::vector<RigConfig> rigs = ReadRigConfig(Path());
  ASSERT_EQ(rigs.size(), 2u);
  EXPECT_EQ(rigs[0].cameras[1].image_prefix, "seqA/cam1/");
  ASSERT_EQ(rigs[1].cameras.size(), 2u);
  EXPECT_TRUE(rigs[1].cameras[0].is_reference);
  const Rigid3 expected =
      *model.sensor_from_rig[2] * model.sensor_from_rig[1]->Inverse();
  EXPECT_LT(
      (rigs[1].cameras[1].cam_from_rig->translation - expected.translation)
          .norm(),
      1e-12);
  EXPECT_EQ(Load(names).scene.rigs.size(), 2u);
}

TEST_F(RigConfigTest, RigsWithoutTellingPrefixAreLeftOut) {
  DatabaseContents contents = MakeContents({"0.png", "1.png", "cam0/0.png"});
  const Scene scene = LoadScene(contents, LoadingBy("none"), Context()).scene;
  WriteRigConfig(Path(), scene, MakeModel(scene));
  const std::vector<RigConfig> rigs = ReadRigConfig(Path());
  ASSERT_EQ(rigs.size(), 1u);
  EXPECT_EQ(rigs[0].cameras[0].image_prefix, "cam0/");
}

// The part of the names that tells the cameras is at the end or between others.
TEST_F(RigConfigTest, CamerasThatNoPrefixTellsHavePatterns) {
  struct Case {
    std::string rule;
    std::vector<std::string> cameras;
    std::string (*name)(const std::string& camera, int frame);
  };
  static const auto kNumber = [](int frame) {
    return std::to_string(1000 + 7 * frame);
  };
  const std::vector<Case> cases = {
      {R"(IMG_\d+_(?<camera>.*)\.jpg)",
       {"cam1", "cam2"},
       [](const std::string& c, int f) {
         return "IMG_" + kNumber(f) + "_" + c + ".jpg";
       }},
      {R"(\d+(?<camera>[LR])\.png)",
       {"L", "R"},
       [](const std::string& c, int f) { return kNumber(f) + c + ".png"; }},
      {R"(day\d/f\d+_(?<camera>[a-z]+)_x\d+\.png)",
       {"left", "right", "rear"},
       [](const std::string& c, int f) {
         return "day" + std::to_string(f % 2) + "/f" + kNumber(f) + "_" + c +
                "_x" + std::to_string(f) + ".png";
       }},
      {R"((?<camera>[AB])_\d+_(?<camera>front|back)\.png)",
       {"A/front", "A/back", "B/front"},
       [](const std::string& c, int f) {
         return c.substr(0, 1) + "_" + kNumber(f) + "_" + c.substr(2) + ".png";
       }}};
  for (const Case& c : cases) {
    std::vector<std::string> names;
    for (const std::string& camera : c.cameras) {
      for (int frame = 0; frame < 5; ++frame) {
        names.push_back(c.name(camera, frame));
      }
    }
    names.pop_back();
    const Scene scene =
        LoadScene(MakeContents(names), LoadingBy(c.rule), Context()).scene;
    ASSERT_EQ(scene.frames.size(), 5u) << c.rule;
    WriteRigConfig(Path(), scene, MakeModel(scene));
    const Scene loaded = Load(names).scene;
    ExpectSameRigs(loaded, scene);
    for (size_t i = 0; i < scene.sensors.size(); ++i) {
      EXPECT_EQ(loaded.sensors[i].name, scene.sensors[i].name);
      EXPECT_TRUE(loaded.sensors[i].sensor_from_rig.has_value());
    }
    // Tables of a model have no names; exports name cameras all the same.
    const Scene from_tables =
        LoadScene(MakeDatabaseContents(scene, ViewGraph()), {}, Context())
            .scene;
    for (size_t i = 0; i < scene.sensors.size(); ++i) {
      EXPECT_EQ(from_tables.sensors[i].name, scene.sensors[i].name);
    }
  }
}

TEST_F(RigConfigTest, PatternsThatCannotBeUsed) {
  EXPECT_THAT(ErrorOf([&] {
                (void)Parse(R"([{"cameras": [{"image_prefix": "a",
                    "image_pattern": "*a", "ref_sensor": true}]}])");
              }),
              HasSubstr("a prefix and a pattern"));
  WriteTextFile(Path(), R"([{"cameras": [
      {"image_pattern": "*_a.png", "ref_sensor": true},
      {"image_pattern": "*_b.png"}]}])");
  EXPECT_THAT(ErrorOf([&] {
                (void)Load({"0_a.png", "1_a.png"});
              }),
              HasSubstr("fits the pattern '*_b.png'"));
  EXPECT_EQ(Load({"0_a.png", "0_b.png", "1_b.png"}).scene.frames.size(), 2u);
}

TEST_F(RigConfigTest, PrefixesThatDoNotFitTheImages) {
  const auto config = [this](const std::string& a, const std::string& b) {
    RigConfig rig;
    rig.cameras.resize(2);
    rig.cameras[0].image_prefix = a;
    rig.cameras[0].is_reference = true;
    rig.cameras[1].image_prefix = b;
    WriteRigConfig(Path(), {rig});
  };
  const std::vector<std::string> names = {"cam1/0.png", "cam10/0.png"};
  config("cam1/", "cam2/");
  EXPECT_THAT(ErrorOf([&] { (void)Load(names); }),
              testing::AllOf(HasSubstr("no image"), HasSubstr("'cam2/'")));
  config("cam1", "cam10/");
  EXPECT_THAT(ErrorOf([&] { (void)Load(names); }),
              testing::AllOf(HasSubstr("'cam10/0.png'"), HasSubstr("both")));
  config("cam1/", "cam10/");
  EXPECT_EQ(Load(names).scene.frames.size(), 1u);
}

}  // namespace
}  // namespace mgsfm

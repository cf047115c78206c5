// SPDX-License-Identifier: BSD-3-Clause
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <map>
#include <set>

#include "mgsfm/base/error.h"
#include "models/rows_to_scene.h"
#include "support/error_of.h"
#include "support/temp_dir.h"

namespace mgsfm {
namespace {

using testing::AllOf;
using testing::HasSubstr;

class RigConfigurationTest : public testing::Test {
 protected:
  FeatureDatabase Open() const {
    return FeatureDatabase((dir_.path() / "a.db").string(),
                           FeatureDatabase::OpenMode::kOrCreate);
  }
  static CameraId AddCamera(FeatureDatabase* database, double focal_length) {
    return database->AddCamera({CameraId(0),
                                CameraModelId::kSimplePinhole,
                                100,
                                80,
                                {focal_length, 50.0, 40.0},
                                true});
  }
  // Two cameras with images a/1, a/2, b/1, b/2.
  void AddTwoCameras(FeatureDatabase* database) const {
    for (const char* folder : {"a", "b"}) {
      const CameraId camera = AddCamera(database, folder[0]);
      database->AddImage(std::string(folder) + "/1.png", camera);
      database->AddImage(std::string(folder) + "/2.png", camera);
    }
  }
  SceneLoadingOptions WithConfig(const std::string& text) const {
    SceneLoadingOptions options;
    options.rig_config_path = (dir_.path() / "rig.json").string();
    WriteTextFile(*options.rig_config_path, text);
    return options;
  }
  // Names of the images of each frame.
  static std::set<std::set<std::string>> FramesOf(
      const DatabaseContents& contents) {
    std::map<ImageId, std::string> names;
    for (const ImageRow& image : contents.images) {
      names.emplace(image.id, image.name);
    }
    std::set<std::set<std::string>> frames;
    for (const FrameRow& frame : contents.frames) {
      std::set<std::string> images;
      for (const auto& data : frame.data) {
        images.insert(names.at(data.image_id));
      }
      frames.insert(images);
    }
    return frames;
  }

  TempDir dir_;
  const std::set<std::set<std::string>> pairs_ = {{"a/1.png", "b/1.png"},
                                                  {"a/2.png", "b/2.png"}};
};

TEST_F(RigConfigurationTest, FindsRigsByFolders) {
  FeatureDatabase database = Open();
  AddTwoCameras(&database);
  const RigConfigurationSummary summary =
      ConfigureRigs({}, &database, Context());
  EXPECT_EQ(summary.num_rigs, 1u);
  EXPECT_EQ(summary.num_sensors, 2u);
  EXPECT_EQ(summary.num_frames, 2u);
  const DatabaseContents contents = database.ReadStructure(Context());
  ASSERT_EQ(contents.rigs.size(), 1u);
  ASSERT_EQ(contents.rigs[0].sensors.size(), 2u);
  ASSERT_TRUE(contents.rigs[0].ref_camera_id.has_value());
  for (const RigSensorRow& sensor : contents.rigs[0].sensors) {
    EXPECT_EQ(sensor.sensor_from_rig.has_value(),
              sensor.camera_id == *contents.rigs[0].ref_camera_id);
  }
  EXPECT_EQ(FramesOf(contents), pairs_);
}

TEST_F(RigConfigurationTest, TakesPosesAndIntrinsicsOfAConfiguration) {
  FeatureDatabase database = Open();
  AddTwoCameras(&database);
  ConfigureRigs(WithConfig(R"([{"cameras": [
        {"image_prefix": "b/", "ref_sensor": true},
        {"image_prefix": "a/", "cam_from_rig_rotation": [0, 1, 0, 0],
         "cam_from_rig_translation": [1, 2, 3],
         "camera_model_name": "PINHOLE",
         "camera_params": [60, 61, 50, 40]}]}])"),
                &database, Context());
  const DatabaseContents contents = database.ReadStructure(Context());
  EXPECT_EQ(FramesOf(contents), pairs_);
  ASSERT_EQ(contents.cameras.size(), 2u);
  EXPECT_EQ(contents.cameras[0].model, CameraModelId::kPinhole);
  EXPECT_EQ(contents.cameras[0].params, (std::vector<double>{60, 61, 50, 40}));
  EXPECT_EQ(contents.cameras[1].params, (std::vector<double>{'b', 50, 40}));
  ASSERT_EQ(contents.rigs.size(), 1u);
  EXPECT_EQ(contents.rigs[0].ref_camera_id, contents.cameras[1].id);
  for (const RigSensorRow& sensor : contents.rigs[0].sensors) {
    if (sensor.camera_id != contents.cameras[0].id) continue;
    EXPECT_EQ(sensor.sensor_from_rig->translation, Eigen::Vector3d(1, 2, 3));
  }
}

// COLMAP's rigs have a camera for each sensor, and images that of theirs.
// The principal point of the database tells that the images are no crops.
TEST_F(RigConfigurationTest, IntrinsicsOfAnotherSizeAreRefused) {
  FeatureDatabase database = Open();
  AddTwoCameras(&database);
  const auto configure = [&](const std::string& params) {
    return ErrorOf([&] {
      ConfigureRigs(
          WithConfig(R"([{"cameras": [{"image_prefix": "a/", "ref_sensor": true,
              "camera_model_name": "SIMPLE_PINHOLE", "camera_params": [)" +
                     params + R"(]}, {"image_prefix": "b/"}]}])"),
          &database, Context());
    });
  };
  EXPECT_THAT(configure("50, 25, 20"),
              AllOf(HasSubstr("camera 'a'"), HasSubstr("rig.json"),
                    HasSubstr("about 50 x 40 px")));
  EXPECT_THAT(configure("100, 50, 800"), HasSubstr("outside of the image"));
  EXPECT_EQ(configure("100, 51, 39"), "no error");
}

TEST_F(RigConfigurationTest, MillimetersAreNamed) {
  FeatureDatabase database = Open();
  AddTwoCameras(&database);
  std::string warnings;
  Context context;
  context.log = [&](LogLevel level, const std::string& message) {
    if (level == LogLevel::kWarning) warnings += message;
  };
  const auto configure = [&](const std::string& x) {
    warnings.clear();
    ConfigureRigs(
        WithConfig(R"([{"cameras": [{"image_prefix": "a/", "ref_sensor": true},
            {"image_prefix": "b/", "cam_from_rig_rotation": [1, 0, 0, 0],
             "cam_from_rig_translation": [)" +
                   x + ", 0, 0]}]}]"),
        &database, context);
    return warnings;
  };
  EXPECT_EQ(configure("-0.54"), "");
  EXPECT_THAT(configure("-540"), HasSubstr("millimeters"));
}

TEST_F(RigConfigurationTest, CopiesACameraThatTwoSensorsShare) {
  FeatureDatabase database = Open();
  const CameraId camera = AddCamera(&database, 90.0);
  for (const char* name : {"a/1.png", "a/2.png", "b/1.png", "b/2.png"}) {
    database.AddImage(name, camera);
  }
  ConfigureRigs({}, &database, Context());
  const DatabaseContents contents = database.ReadStructure(Context());
  ASSERT_EQ(contents.cameras.size(), 2u);
  EXPECT_EQ(contents.cameras[0].params, contents.cameras[1].params);
  std::map<std::string, CameraId> camera_of;
  for (const ImageRow& image : contents.images) {
    camera_of.emplace(image.name, image.camera_id);
  }
  EXPECT_EQ(camera_of.at("a/1.png"), camera_of.at("a/2.png"));
  EXPECT_EQ(camera_of.at("b/1.png"), camera_of.at("b/2.png"));
  EXPECT_NE(camera_of.at("a/1.png"), camera_of.at("b/1.png"));
  for (const FrameRow& frame : contents.frames) {
    for (const FrameDataRow& data : frame.data) {
      for (const ImageRow& image : contents.images) {
        if (image.id != data.image_id) continue;
        EXPECT_EQ(image.camera_id, data.camera_id);
      }
    }
  }
}

TEST_F(RigConfigurationTest, JoinsEqualCamerasOfASensor) {
  FeatureDatabase database = Open();
  for (const char* name : {"a/1.png", "a/2.png", "b/1.png", "b/2.png"}) {
    database.AddImage(name, AddCamera(&database, 90.0));
  }
  ConfigureRigs({}, &database, Context());
  const DatabaseContents contents = database.ReadStructure(Context());
  std::set<CameraId> used;
  for (const ImageRow& image : contents.images) used.insert(image.camera_id);
  EXPECT_EQ(used.size(), 2u);
  EXPECT_EQ(FramesOf(contents), pairs_);
}

// Earlier rows have no part in those written next, and writing the same again
// changes nothing.
TEST_F(RigConfigurationTest, ReplacesWhatIsThere) {
  FeatureDatabase database = Open();
  AddTwoCameras(&database);
  ConfigureRigs({}, &database, Context());
  SceneLoadingOptions single;
  single.rig_name_rule = "none";
  EXPECT_EQ(ConfigureRigs(single, &database, Context()).num_frames, 4u);
  EXPECT_EQ(database.ReadStructure(Context()).rigs.size(), 2u);
  for (int i = 0; i < 2; ++i) {
    ConfigureRigs({}, &database, Context());
    const DatabaseContents contents = database.ReadStructure(Context());
    EXPECT_EQ(contents.rigs.size(), 1u);
    EXPECT_EQ(contents.cameras.size(), 2u);
    EXPECT_EQ(FramesOf(contents), pairs_);
  }
}

TEST_F(RigConfigurationTest, LeavesADatabaseAloneThatItCannotConfigure) {
  FeatureDatabase database = Open();
  EXPECT_THROW(ConfigureRigs({}, &database, Context()), Error);
  AddTwoCameras(&database);
  ConfigureRigs({}, &database, Context());
  try {
    ConfigureRigs(WithConfig(R"([{"cameras": [
                    {"image_prefix": "c/", "ref_sensor": true}]}])"),
                  &database, Context());
    ADD_FAILURE() << "no image has the prefix";
  } catch (const Error& error) {
    EXPECT_THAT(error.what(), HasSubstr("'c/'"));
  }
  EXPECT_EQ(FramesOf(database.ReadStructure(Context())), pairs_);
}

}  // namespace
}  // namespace mgsfm

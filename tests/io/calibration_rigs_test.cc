// SPDX-License-Identifier: BSD-3-Clause
// Calibrations of all formats, as rigs of a scene.
#include "io/calibration_fixture.h"
#include "mgsfm/models/scene_loading.h"
#include "mgsfm/models/trajectory_io.h"
#include "support/shared_data.h"

namespace mgsfm {
namespace {

using testing::AllOf;
using testing::HasSubstr;

class CalibrationRigsTest : public CalibrationTest {
 protected:
  CalibrationRigsTest() {
    context_.log = [this](LogLevel, const std::string& text) {
      log_ += text + "\n";
    };
    options_.calibration_path = Path("camchain.yaml");
    Write("camchain.yaml", kKalibr);
  }
  Scene Load(const std::vector<std::string>& names) {
    DatabaseContents contents = MakeContents(names);
    for (Camera& camera : contents.cameras) {
      camera.width_px = width_px_;
      camera.height_px = height_px_;
    }
    return LoadScene(std::move(contents), options_, context_).scene;
  }
  std::string LoadError(const std::vector<std::string>& names) {
    return ErrorOf([&] { Load(names); });
  }

  int width_px_ = 752;
  int height_px_ = 480;
  SceneLoadingOptions options_;
  Context context_;
  std::string log_;
};

TEST_F(CalibrationRigsTest, WarnsOfTimeShifts) {
  std::string text = kKalibr;
  text.insert(text.find("cam1:"), "  timeshift_cam_imu: 0.1\n");
  text.insert(text.find("cam2:"), "  timeshift_cam_imu: 0.1004\n");
  Write("camchain.yaml", text + "  timeshift_cam_imu: 0.45\n");
  Load({"cam0/1.png", "cam1/1.png", "cam2/1.png"});
  EXPECT_THAT(log_, HasSubstr("camera 'cam2' is 0.35 s late relative to"));
  EXPECT_THAT(log_, testing::Not(HasSubstr("camera 'cam1' is")));
}

TEST_F(CalibrationRigsTest, SetsIntrinsicsAndPoses) {
  const Scene scene = Load({"cam0/1.png", "cam1/1.png", "cam2/1.png"});
  ASSERT_EQ(scene.rigs.size(), 1u);
  ASSERT_EQ(scene.frames.size(), 1u);
  ASSERT_EQ(scene.cameras.size(), 3u);
  EXPECT_EQ(scene.cameras[0].model, CameraModelId::kOpenCV);
  EXPECT_TRUE(scene.cameras[0].has_prior_focal_length);
  EXPECT_EQ(scene.cameras[1].model, CameraModelId::kOpenCVFisheye);
  EXPECT_TRUE(scene.IsReference(0));
  EXPECT_NEAR(scene.sensors[1].sensor_from_rig->translation.x(), -0.11, 1e-12);
  EXPECT_THAT(log_, HasSubstr("camera 'left' is that of 'cam0/' (1 images), "
                              "OPENCV, pose known"));
}

TEST_F(CalibrationRigsTest, PosesRelativeToALaterCameraAreKept) {
  std::string text = kKalibr;
  text.replace(text.find("T_cn_cnm1"), 9, "T_unknown");
  Write("camchain.yaml", text);
  const Scene scene = Load({"cam0/1.png", "cam1/1.png", "cam2/1.png"});
  EXPECT_TRUE(scene.IsReference(1));
  EXPECT_FALSE(scene.sensors[0].sensor_from_rig.has_value());
  EXPECT_NEAR(scene.sensors[2].sensor_from_rig->translation.x(), 0.5, 1e-12);
  EXPECT_THAT(log_, HasSubstr("OPENCV, pose to be estimated"));
}

// Topics take precedence over cam0, cam1, ..., which follow their order.
TEST_F(CalibrationRigsTest, MatchesTopicsNamesAndNumbers) {
  const auto first_params = [&](const std::vector<std::string>& names,
                                const std::string& name) {
    const Scene scene = Load(names);
    for (const Image& image : scene.images) {
      if (image.name == name) return scene.cameras[image.camera_idx].params[0];
    }
    return 0.0;
  };
  EXPECT_EQ(first_params({"x/RIGHT/1.png", "x/LEFT/1.png"}, "x/RIGHT/1.png"),
            400.0);
  EXPECT_EQ(first_params({"image_00/d/1.png", "image_01/d/1.png"},
                         "image_01/d/1.png"),
            400.0);
  EXPECT_EQ(first_params({"left_01.png", "right_01.png"}, "right_01.png"),
            400.0);
}

TEST_F(CalibrationRigsTest, OuterFoldersHaveRigsOfTheirOwn) {
  const Scene scene = Load({"a/cam0/1.png", "a/cam1/1.png", "b/cam0/1.png",
                            "b/cam1/1.png", "other/1.png"});
  EXPECT_EQ(scene.rigs.size(), 3u);
  EXPECT_EQ(scene.frames.size(), 3u);
  EXPECT_THAT(log_, AllOf(HasSubstr("1 images belong to no camera"),
                          HasSubstr("'cam2' has no images")));
}

TEST_F(CalibrationRigsTest, ImagesOfAnotherSizeScaleIntrinsics) {
  width_px_ /= 2;
  height_px_ /= 2;
  const Scene scene = Load({"cam0/1.png", "cam1/1.png"});
  EXPECT_DOUBLE_EQ(scene.cameras[1].params[0], 200.0);
  EXPECT_DOUBLE_EQ(scene.cameras[1].params[2], 185.25);
  EXPECT_DOUBLE_EQ(scene.cameras[1].params[4], -0.01);
  height_px_ = 500;
  EXPECT_THAT(
      LoadError({"cam0/1.png"}),
      AllOf(HasSubstr("line 2"), HasSubstr("752x480"), HasSubstr("376x500")));
}

TEST_F(CalibrationRigsTest, BadMatchesAreRefused) {
  EXPECT_THAT(LoadError({"a/1.png", "b/1.png"}),
              AllOf(HasSubstr("no images belong to its cameras 'left' 'right'"),
                    HasSubstr("'a/' 'b/'"), HasSubstr("rename")));
  EXPECT_THAT(LoadError({"left/right/1.png"}), HasSubstr("fits the cameras"));
  Write("camchain.yaml", std::string(kKalibr).replace(
                             std::string(kKalibr).find("pinhole"), 7, "other"));
  EXPECT_THAT(LoadError({"cam0/1.png"}),
              AllOf(HasSubstr("line 2"), HasSubstr("'other'")));
  EXPECT_EQ(LoadError({"right/1.png"}), "no error");
  options_.rig_config_path = Path("rig.json");
  EXPECT_THAT(LoadError({"cam0/1.png"}), HasSubstr("set one of them"));
}

TEST_F(CalibrationRigsTest, ReadsRigConfigurations) {
  options_.calibration_path = Write("rig.json", R"([{"cameras": [
      {"image_prefix": "cam0/", "ref_sensor": true},
      {"image_prefix": "cam1/", "cam_from_rig_rotation": [1, 0, 0, 0],
       "cam_from_rig_translation": [-0.5, 0, 0]}]}])");
  const Scene scene = Load({"cam0/1.png", "cam1/1.png"});
  EXPECT_EQ(scene.sensors[1].sensor_from_rig->translation.x(), -0.5);
}

TEST_F(CalibrationRigsTest, FramesByTime) {
  options_.frame_max_time_difference_s = 1e-5;
  const Scene scene =
      Load({"cam0/1403636579000000000.png", "cam0/1403636580000000000.png",
            "cam1/1403636580000004000.png", "cam1/1403636578999998000.png"});
  EXPECT_EQ(scene.frames.size(), 2u);
  EXPECT_TRUE(scene.sensors[1].sensor_from_rig.has_value());
}

// Without the option, each image would silently be a frame of its own.
TEST_F(CalibrationRigsTest, NamesThatShareNoFrameAreAWarning) {
  const std::vector<std::string> jittered = {
      "cam0/1403636579000000000.png", "cam0/1403636580000000000.png",
      "cam1/1403636580000004000.png", "cam1/1403636578999998000.png"};
  EXPECT_EQ(Load(jittered).frames.size(), 4u);
  EXPECT_THAT(log_, HasSubstr("set frame_max_time_difference_s 8e-06"));
  log_.clear();
  Load({"cam0/a.png", "cam1/b.png"});
  EXPECT_THAT(log_, HasSubstr("no two cameras of a rig have images of the "
                              "same name"));
  log_.clear();
  Load({"cam0/a.png", "cam1/a.png", "cam1/b.png"});
  Load({"cam0/a.png", "cam0/b.png"});
  EXPECT_EQ(log_.find("same name"), std::string::npos);
}

// The list is longer than the name of a file may be.
TEST_F(CalibrationTest, ManyFilesAreRead) {
  std::string list;
  for (int i = 0; i < 40; ++i) {
    if (i > 0) list += ',';
    list += "no_such_camera_" + std::to_string(i) + ".yaml";
  }
  EXPECT_THAT(ErrorOf([&] { ReadCalibration(list); }),
              AllOf(HasSubstr("'no_such_camera_0.yaml'"),
                    testing::Not(HasSubstr("camera_1"))));
}

TEST_F(CalibrationTest, OtherFilesAreRefused) {
  for (const char* text : {"", "[]", "a: 1", "- 3", "text"}) {
    EXPECT_THAT(ErrorOfFile("x.yaml", text), HasSubstr("not a calibration"));
    EXPECT_THAT(ErrorOfFile("x.txt", text), HasSubstr("not a calibration"));
  }
  EXPECT_THAT(ErrorOf([&] { (void)ReadCalibration(Path("none.yaml")); }),
              HasSubstr("none.yaml"));
  EXPECT_THAT(ErrorOf([&] { (void)ReadCalibration(Path("")); }),
              HasSubstr("no calibration of a camera"));
  // An alias that contains itself.
  EXPECT_THAT(ErrorOfChange("a.yaml", kKalibr, "intrinsics: [458.6",
                            "intrinsics: &a [*a"),
              HasSubstr("vector or matrix"));
}

// The baselines of the data sets, and the poses by another reader.
TEST(SharedCalibration, EurocAndKitti) {
  const auto euroc = FindSharedData("euroc_v101_stereo");
  const auto kitti = FindSharedData("kitti06_stereo");
  if (!euroc || !kitti) GTEST_SKIP() << "no data; see shared_data.h";
  const Cameras stereo = ReadCalibration(euroc->string());
  ASSERT_EQ(stereo.size(), 2u);
  EXPECT_NEAR(CamFromFirst(stereo, 1).translation.norm(), 0.1101, 1e-4);
  const Rigid3 other = ReadEurocCalibration(*euroc / "sensor1.yaml");
  EXPECT_EQ(stereo[1].cam_from_base->translation, other.translation);
  const Cameras rectified = ReadCalibration((*kitti / "calib.txt").string());
  ASSERT_EQ(rectified.size(), 2u);
  EXPECT_NEAR(CamFromFirst(rectified, 1).translation.x(), -0.5372, 1e-4);
}

}  // namespace
}  // namespace mgsfm

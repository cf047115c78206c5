// SPDX-License-Identifier: BSD-3-Clause
#include "io/calibration/calibration.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <filesystem>

#include "geometry/so3.h"
#include "io/test_database.h"
#include "mgsfm/io/models/scene_loading.h"
#include "mgsfm/io/models/trajectory_io.h"
#include "support/shared_data.h"
#include "support/temp_dir.h"

namespace mgsfm {
namespace {

using testing::AllOf;
using testing::ElementsAre;
using testing::HasSubstr;

using Cameras = std::vector<CalibratedCamera>;
using Params = std::vector<double>;

// As `kalibr_calibrate_cameras` and `kalibr_calibrate_imu_camera` write it.
constexpr const char* kKalibr = R"(cam0:
  cam_overlaps: [1, 2]
  camera_model: pinhole
  distortion_coeffs: [-0.28, 0.07, 0.0002, 1.8e-05]
  distortion_model: radtan
  intrinsics: [458.6, 457.3, 367.2, 248.4]
  resolution: [752, 480]
  rostopic: /alphasense/left/image_raw
cam1:
  T_cn_cnm1:
  - [1.0, 0.0, 0.0, -0.11]
  - [0.0, 1.0, 0.0, 0.0]
  - [0.0, 0.0, 1.0, 0.0]
  - [0.0, 0.0, 0.0, 1.0]
  camera_model: pinhole
  distortion_coeffs: [-0.01, 0.02, -0.03, 0.04]
  distortion_model: equidistant
  intrinsics: [400.0, 401.0, 370.0, 250.0]
  resolution: [752, 480]
  rostopic: /alphasense/right/image_raw
cam2:
  T_cn_cnm1:
  - [0.0, 0.0, -1.0, 0.5]
  - [0.0, 1.0, 0.0, 0.0]
  - [1.0, 0.0, 0.0, 0.0]
  - [0.0, 0.0, 0.0, 1.0]
  camera_model: eucm
  distortion_coeffs: []
  distortion_model: none
  intrinsics: [0.6, 1.1, 300.0, 301.0, 375.0, 239.0]
  resolution: [752, 480]
  rostopic: /cam2/image_raw
)";

// EuRoC's sensor.yaml of a camera, with the header of OpenCV.
constexpr const char* kEuroc = R"(%YAML:1.0
# General sensor definitions.
sensor_type: camera
comment: VI-Sensor cam0 (MT9M034)

T_BS:
  cols: 4
  rows: 4
  data: [0.0, -1.0, 0.0, -0.02,
         1.0, 0.0, 0.0, -0.06,
         0.0, 0.0, 1.0, 0.01,
         0.0, 0.0, 0.0, 1.0]

rate_hz: 20
resolution: [752, 480]
camera_model: pinhole
intrinsics: [458.654, 457.296, 367.215, 248.375] #fu, fv, cu, cv
distortion_model: radial-tangential
distortion_coefficients: [-0.28340811, 0.07395907, 0.00019359, 1.76187114e-05]
)";

// ROS's camera_calibration, for the right camera of a stereo pair.
constexpr const char* kRos = R"(image_width: 640
image_height: 480
camera_name: right
camera_matrix:
  rows: 3
  cols: 3
  data: [430.15, 0, 306.69, 0, 430.53, 227.22, 0, 0, 1]
distortion_model: plumb_bob
distortion_coefficients:
  rows: 1
  cols: 5
  data: [-0.33, 0.13, 0.0009, -0.002, 0.01]
rectification_matrix:
  rows: 3
  cols: 3
  data: [0, -1, 0, 1, 0, 0, 0, 0, 1]
projection_matrix:
  rows: 3
  cols: 4
  data: [400, 0, 300, -48, 0, 400, 230, 0, 0, 0, 1, 0]
)";

// cv::FileStorage, as OpenCV's sample calibration.cpp uses it.
constexpr const char* kOpenCv = R"(%YAML:1.0
---
calibration_Time: "Mon 01 May 2023"
image_Width: 640
image_Height: 480
Camera_Matrix: !!opencv-matrix
   rows: 3
   cols: 3
   dt: d
   data: [ 6.5e+02, 0., 3.195e+02, 0., 6.6e+02, 2.395e+02, 0., 0., 1. ]
Distortion_Coefficients: !!opencv-matrix
   rows: 8
   cols: 1
   dt: d
   data: [ 1e-01, 2e-01, 3e-03, 4e-03, 5e-02, 6e-02, 7e-02, 8e-02 ]
)";

// KITTI-360's image_02.yaml.
constexpr const char* kMei = R"(%YAML:1.0
---
model_type: MEI
camera_name: image_02
image_width: 1400
image_height: 1400
mirror_parameters:
   xi: 2.2134047507854890e+00
distortion_parameters:
   k1: 1.6798235660113681e-02
   k2: 1.6548773243373522e+00
   p1: 4.2223943394772046e-04
   p2: 4.2462134260997584e-04
projection_parameters:
   gamma1: 1.3363220825849971e+03
   gamma2: 1.3357883350012958e+03
   u0: 7.1694323510126321e+02
   v0: 7.0576498308221585e+02
)";

constexpr const char* kKannalaBrandt = R"(%YAML:1.0
---
model_type: KANNALA_BRANDT
camera_name: front
image_width: 640
image_height: 512
projection_parameters:
   k2: -0.01
   k3: 0.02
   k4: -0.03
   k5: 0.04
   mu: 287.1
   mv: 287.2
   u0: 319.5
   v0: 255.5
)";

constexpr const char* kKittiOdometry =
    "P0: 700 0 600 0 0 700 180 0 0 0 1 0\n"
    "P1: 700 0 600 -378 0 700 180 0 0 0 1 0\n"
    "P2: 700 0 600 42 0 700 180 0.7 0 0 1 0.001\n"
    "Tr: 0 -1 0 0 0 0 -1 -0.08 1 0 0 -0.27\n";

constexpr const char* kKitti360 =
    "calib_time: 28-May-2013\n"
    "corner_dist: 9.950000e-02\n"
    "S_00: 1.392000e+03 5.120000e+02\n"
    "R_rect_00: 1 0 0 0 1 0 0 0 1\n"
    "S_rect_00: 1.408000e+03 3.760000e+02\n"
    "P_rect_00: 552 0 682 0 0 552 238 0 0 0 1 0\n"
    "R_rect_01: 0 -1 0 1 0 0 0 0 1\n"
    "S_rect_01: 1.408000e+03 3.760000e+02\n"
    "P_rect_01: 552 0 682 -328 0 552 238 0 0 0 1 0\n";
constexpr const char* kKitti360Poses =
    "image_00: 1 0 0 1.5 0 1 0 0.3 0 0 1 0.9\n"
    "image_01: 1 0 0 1.6 0 1 0 0.9 0 0 1 0.8\n"
    "image_02: 0 -1 0 0.7 1 0 0 1.1 0 0 1 1.0\n";

constexpr const char* kCalibratedSensors = R"([
{"token": "a", "sensor_token": "s1", "translation": [1.7, 0.0, 1.5],
 "rotation": [0.5, -0.5, 0.5, -0.5],
 "camera_intrinsic": [[1266.4, 0.0, 816.3], [0.0, 1266.5, 491.5],
                      [0.0, 0.0, 1.0]]},
{"token": "b", "sensor_token": "s2", "translation": [0.9, 0.0, 1.8],
 "rotation": [1, 0, 0, 0], "camera_intrinsic": []},
{"token": "c", "sensor_token": "s3", "translation": [1.0, 0.5, 1.5],
 "rotation": [1.0, 0.0, 0.0, 0.0],
 "camera_intrinsic": [[800.0, 0.0, 826.6], [0.0, 800.0, 479.8],
                      [0.0, 0.0, 1.0]]}])";
constexpr const char* kSensors = R"([
{"token": "s1", "channel": "CAM_FRONT", "modality": "camera"},
{"token": "s2", "channel": "LIDAR_TOP", "modality": "lidar"},
{"token": "s3", "channel": "CAM_BACK", "modality": "camera"}])";

constexpr const char* kArgoverse = R"({"camera_data_": [
 {"key": "image_raw_ring_front_center", "value": {
   "focal_length_x_px_": 1392.1, "focal_length_y_px_": 1392.2,
   "focal_center_x_px_": 980.1, "focal_center_y_px_": 604.3, "skew_": 0.0,
   "distortion_coefficients_": [-0.1720396, 0.11689394, -0.03],
   "vehicle_SE3_camera_": {
     "rotation": {"coefficients": [1.0, 0.0, 0.0, 0.0]},
     "translation": [1.6, 0.0, 1.4]}}}]})";

class CalibrationTest : public testing::Test {
 protected:
  std::string Path(const std::string& name) const {
    return (dir_.path() / name).string();
  }
  std::string Write(const std::string& name, const std::string& text) const {
    std::filesystem::create_directories(
        std::filesystem::path(Path(name)).parent_path());
    WriteTextFile(Path(name), text);
    return Path(name);
  }
  std::string ErrorOfFile(const std::string& name,
                          const std::string& text) const {
    const std::string path = Write(name, text);
    return ErrorOf([&] { (void)ReadCalibration(path); });
  }
  // The error of `text` with `before` replaced by `after`.
  std::string ErrorOfChange(const std::string& name, std::string text,
                            const std::string& before,
                            const std::string& after) const {
    const size_t begin = text.find(before);
    EXPECT_NE(begin, std::string::npos) << before;
    return ErrorOfFile(name, text.replace(begin, before.size(), after));
  }

  const TempDir dir_;
};

Rigid3 CamFromFirst(const Cameras& cameras, size_t k) {
  return cameras[k].cam_from_base.value() *
         cameras[0].cam_from_base.value().Inverse();
}

void ExpectPose(const Rigid3& pose, const Eigen::Matrix3d& rotation,
                const Eigen::Vector3d& translation) {
  EXPECT_NEAR(AngleBetween(pose.rotation, Eigen::Quaterniond(rotation)), 0.0,
              1e-7);
  EXPECT_NEAR((pose.translation - translation).norm(), 0.0, 1e-9);
}

TEST_F(CalibrationTest, Kalibr) {
  const Cameras cameras = ReadCalibration(Write("camchain.yaml", kKalibr));
  ASSERT_EQ(cameras.size(), 3u);
  EXPECT_THAT(cameras[0].names, ElementsAre("left", "cam0"));
  EXPECT_EQ(cameras[0].model, CameraModelId::kOpenCV);
  EXPECT_EQ(cameras[0].params,
            (Params{458.6, 457.3, 367.7, 248.9, -0.28, 0.07, 0.0002, 1.8e-05}));
  EXPECT_EQ(cameras[0].size_px, std::make_pair(752, 480));
  EXPECT_EQ(cameras[1].model, CameraModelId::kOpenCVFisheye);
  EXPECT_EQ(cameras[2].model, CameraModelId::kEucm);
  EXPECT_EQ(cameras[2].params, (Params{300.0, 301.0, 375.5, 239.5, 0.6, 1.1}));
  ExpectPose(CamFromFirst(cameras, 1), Eigen::Matrix3d::Identity(),
             {-0.11, 0.0, 0.0});
  // The chain cam2_from_cam1 * cam1_from_cam0, by hand.
  Eigen::Matrix3d rotation;
  rotation << 0, 0, -1, 0, 1, 0, 1, 0, 0;
  ExpectPose(CamFromFirst(cameras, 2), rotation, {0.5, 0.0, -0.11});
}

TEST_F(CalibrationTest, KalibrWithoutChain) {
  std::string text = kKalibr;
  text.replace(text.find("T_cn_cnm1"), 9, "T_unknown");
  const Cameras cameras = ReadCalibration(Write("camchain.yaml", text));
  for (const CalibratedCamera& camera : cameras) {
    EXPECT_FALSE(camera.cam_from_base.has_value());
  }
}

TEST_F(CalibrationTest, EurocFolder) {
  std::string second = kEuroc;
  second.replace(second.find("-0.02,"), 6, "0.09, ");
  Write("mav0/cam0/sensor.yaml", kEuroc);
  Write("mav0/cam1/sensor.yaml", second);
  Write("mav0/imu0/sensor.yaml",
        "sensor_type: imu\nT_BS:\n  data: [1, 0]\nrate_hz: 200\n");
  Write("mav0/readme.txt", "a text\n");
  const Cameras cameras = ReadCalibration(Path("mav0"));
  ASSERT_EQ(cameras.size(), 2u);
  EXPECT_THAT(cameras[0].names, ElementsAre("cam0"));
  EXPECT_EQ(cameras[0].params,
            (Params{458.654, 457.296, 367.715, 248.875, -0.28340811, 0.07395907,
                    0.00019359, 1.76187114e-05}));
  // 0.11 m along the x axis of the body is along -y of the cameras.
  ExpectPose(CamFromFirst(cameras, 1), Eigen::Matrix3d::Identity(),
             {0.0, 0.11, 0.0});
}

TEST_F(CalibrationTest, RosStereoPair) {
  std::string left = kRos;
  left.replace(left.find("right"), 5, "left");
  left.replace(left.find("-48"), 3, "0");
  const Cameras cameras = ReadCalibration(Write("left.yaml", left) + "," +
                                          Write("right.yaml", kRos));
  ASSERT_EQ(cameras.size(), 2u);
  EXPECT_EQ(cameras[1].model, CameraModelId::kFullOpenCV);
  EXPECT_EQ(cameras[1].params,
            (Params{430.15, 430.53, 307.19, 227.72, -0.33, 0.13, 0.0009, -0.002,
                    0.01, 0.0, 0.0, 0.0}));
  // Rectified cameras are 48 / 400 m apart along their x axes.
  const Rigid3 pose = CamFromFirst(cameras, 1);
  EXPECT_NEAR(pose.translation.norm(), 0.12, 1e-12);
  Eigen::Matrix3d rectification;
  rectification << 0, -1, 0, 1, 0, 0, 0, 0, 1;
  ExpectPose(pose, Eigen::Matrix3d::Identity(),
             rectification.transpose() * Eigen::Vector3d(-0.12, 0.0, 0.0));
}

TEST_F(CalibrationTest, SingleCamerasOfOpenCvHaveNoPose) {
  const Cameras cameras = ReadCalibration(Write("front.yaml", kOpenCv) + "," +
                                          Write("rear.yml", kOpenCv));
  ASSERT_EQ(cameras.size(), 2u);
  EXPECT_THAT(cameras[1].names, ElementsAre("rear"));
  EXPECT_EQ(cameras[0].model, CameraModelId::kFullOpenCV);
  EXPECT_EQ(cameras[0].params, (Params{650, 660, 320, 240, 0.1, 0.2, 0.003,
                                       0.004, 0.05, 0.06, 0.07, 0.08}));
  EXPECT_FALSE(cameras[0].cam_from_base.has_value());
}

TEST_F(CalibrationTest, Camodocal) {
  const Cameras fisheye = ReadCalibration(Write("cam.yaml", kKannalaBrandt));
  EXPECT_EQ(fisheye[0].model, CameraModelId::kOpenCVFisheye);
  EXPECT_EQ(fisheye[0].params,
            (Params{287.1, 287.2, 320, 256, -0.01, 0.02, -0.03, 0.04}));
  const Cameras mirror = ReadCalibration(Write("image_02.yaml", kMei));
  EXPECT_FALSE(mirror[0].model.has_value());
  EXPECT_THAT(mirror[0].why_no_model, HasSubstr("'MEI'"));
}

TEST_F(CalibrationTest, KittiOdometry) {
  const Cameras cameras = ReadCalibration(Write("calib.txt", kKittiOdometry));
  ASSERT_EQ(cameras.size(), 3u);
  EXPECT_EQ(cameras[0].model, CameraModelId::kPinhole);
  EXPECT_EQ(cameras[0].params, (Params{700, 700, 600.5, 180.5}));
  ExpectPose(CamFromFirst(cameras, 1), Eigen::Matrix3d::Identity(),
             {-0.54, 0.0, 0.0});
  // K^-1 (42, 0.7, 0.001) by hand.
  ExpectPose(CamFromFirst(cameras, 2), Eigen::Matrix3d::Identity(),
             {(42 - 0.6) / 700, (0.7 - 0.18) / 700, 0.001});
}

// The pose in the vehicle of a rectified camera: rect_from_cam *
// (vehicle_from_cam)^-1.
TEST_F(CalibrationTest, Kitti360Folder) {
  Write("calibration/perspective.txt", kKitti360);
  Write("calibration/calib_cam_to_pose.txt", kKitti360Poses);
  Write("calibration/image_02.yaml", kMei);
  const Cameras cameras = ReadCalibration(Path("calibration"));
  ASSERT_EQ(cameras.size(), 3u);
  EXPECT_EQ(cameras[0].names.front(), "image_02");
  EXPECT_EQ(cameras[1].size_px, std::make_pair(1408, 376));
  EXPECT_THAT(cameras[1].cam_from_base->Center(),
              Eigen::Vector3d(1.5, 0.3, 0.9));
  EXPECT_NEAR(
      (cameras[2].cam_from_base->Center() - Eigen::Vector3d(1.6, 0.9, 0.8))
          .norm(),
      0.0, 1e-12);
  Eigen::Matrix3d rectification;
  rectification << 0, -1, 0, 1, 0, 0, 0, 0, 1;
  EXPECT_TRUE(cameras[2].cam_from_base->rotation.toRotationMatrix().isApprox(
      rectification));
}

TEST_F(CalibrationTest, NuScenesFolder) {
  Write("calibrated_sensor.json", kCalibratedSensors);
  Write("sensor.json", kSensors);
  Write("sample_data.json", "not read");
  const Cameras cameras = ReadCalibration(Path(""));
  ASSERT_EQ(cameras.size(), 2u);
  EXPECT_THAT(cameras[0].names, ElementsAre("CAM_FRONT"));
  EXPECT_EQ(cameras[0].params, (Params{1266.4, 1266.5, 816.8, 492.0}));
  EXPECT_NEAR(
      (cameras[0].cam_from_base->Center() - Eigen::Vector3d(1.7, 0.0, 1.5))
          .norm(),
      0.0, 1e-12);
  // The front camera looks along x of the vehicle.
  EXPECT_NEAR((cameras[0].cam_from_base->rotation * Eigen::Vector3d::UnitX() -
               Eigen::Vector3d::UnitZ())
                  .norm(),
              0.0, 1e-12);
}

TEST_F(CalibrationTest, ObjectsByCamera) {
  const Cameras cameras = ReadCalibration(Write("cameras.json", R"({
    "CAM_FRONT": {"camera_intrinsic": [[800, 0, 400], [0, 800, 300], [0, 0, 1]],
                  "rotation": [1, 0, 0, 0], "translation": [1, 2, 3]}})"));
  EXPECT_THAT(cameras[0].names, ElementsAre("CAM_FRONT"));
}

TEST_F(CalibrationTest, Argoverse) {
  const Cameras cameras = ReadCalibration(Write("calib.json", kArgoverse));
  EXPECT_THAT(cameras[0].names, ElementsAre("ring_front_center"));
  EXPECT_EQ(cameras[0].model, CameraModelId::kFullOpenCV);
  EXPECT_EQ(cameras[0].params[4], -0.1720396);
  EXPECT_EQ(cameras[0].params[8], -0.03);
}

// ------------------------------------------------------------- bad files

TEST_F(CalibrationTest, MalformedFilesNameLineAndRemedy) {
  EXPECT_THAT(ErrorOfChange("a.yaml", kKalibr, "intrinsics: [458.6,",
                            "intrinsics: [x,"),
              AllOf(HasSubstr("a.yaml', line 6"), HasSubstr("'x'"),
                    HasSubstr("correct it")));
  EXPECT_THAT(ErrorOfChange("a.yaml", kKalibr, "[752, 480]", "[752]"),
              AllOf(HasSubstr("line 7"), HasSubstr("[width, height]")));
  EXPECT_THAT(ErrorOfChange("a.yaml", kKalibr, "- [1.0, 0.0, 0.0, -0.11]",
                            "- [2.0, 0.0, 0.0, -0.11]"),
              AllOf(HasSubstr("line 11"), HasSubstr("not a rigid transform")));
  EXPECT_THAT(ErrorOfChange("a.yaml", kKalibr, "  intrinsics", " intrinsics"),
              AllOf(HasSubstr("line 6"), HasSubstr("not valid YAML")));
  EXPECT_THAT(ErrorOfChange("a.yaml", kKalibr, "resolution: [752, 480]",
                            "resolution: [752, -480]"),
              AllOf(HasSubstr("line 7"), HasSubstr("positive integer")));
  EXPECT_THAT(ErrorOfChange("s.yaml", kEuroc, "intrinsics:", "other:"),
              AllOf(HasSubstr("s.yaml', line 3"),
                    HasSubstr("lacks the key 'intrinsics'")));
  EXPECT_THAT(ErrorOfChange("s.yaml", kEuroc, "0.0, 0.0, 0.0, 1.0]", "0.0]"),
              AllOf(HasSubstr("line 7"), HasSubstr("13 numbers")));
  EXPECT_THAT(ErrorOfChange("r.yaml", kRos, "[430.15, 0,", "[430.15,"),
              AllOf(HasSubstr("line 5"), HasSubstr("8 numbers; give 9")));
  EXPECT_THAT(ErrorOfChange("r.yaml", kRos, "[0, -1, 0, 1", "[0, -1, 0, 2"),
              AllOf(HasSubstr("line 14"), HasSubstr("not a rotation")));
  EXPECT_THAT(ErrorOfChange("m.yaml", kKannalaBrandt, "   mu:", "   nu:"),
              AllOf(HasSubstr("line 8"), HasSubstr("'mu'")));
  EXPECT_THAT(ErrorOfChange("calib.txt", kKittiOdometry, "-378 0", "-378"),
              AllOf(HasSubstr("calib.txt', line 2"), HasSubstr("give 12")));
  EXPECT_THAT(ErrorOfChange("calib.txt", kKittiOdometry, "-378", "nan"),
              AllOf(HasSubstr("line 2"), HasSubstr("'nan'")));
  EXPECT_THAT(ErrorOfChange("c.json", kArgoverse, "1392.1", "\"f\""),
              AllOf(HasSubstr("c.json', line 3"), HasSubstr("'f'")));
  EXPECT_THAT(ErrorOfFile("n.json", kCalibratedSensors),
              AllOf(HasSubstr("n.json', line 2"), HasSubstr("sensor.json")));
  Write("sensor.json", kSensors);
  EXPECT_THAT(
      ErrorOfChange("n.json", kCalibratedSensors, "[1.7, 0.0, 1.5]", "[1.7]"),
      AllOf(HasSubstr("n.json', line 2"), HasSubstr("give 3")));
}

TEST_F(CalibrationTest, OtherFilesAreRefused) {
  for (const char* text : {"", "[]", "a: 1", "- 3", "text"}) {
    EXPECT_THAT(ErrorOfFile("x.yaml", text), HasSubstr("no calibration"));
    EXPECT_THAT(ErrorOfFile("x.txt", text), HasSubstr("no calibration"));
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

TEST_F(CalibrationTest, LensesWithoutModelHaveAReason) {
  const auto reason = [&](const std::string& before, const std::string& after) {
    std::string text = kKalibr;
    text.replace(text.find(before), before.size(), after);
    return ReadCalibration(Write("a.yaml", text))[0].why_no_model;
  };
  EXPECT_EQ(reason("pinhole", "pinhole"), "");
  EXPECT_THAT(reason("pinhole", "omni"), HasSubstr("'omni'"));
  EXPECT_THAT(reason("pinhole", "ds"), HasSubstr("'ds'"));
  EXPECT_THAT(reason("radtan", "other"), HasSubstr("'other'"));
  EXPECT_THAT(reason("-0.28, 0.07, 0.0002, 1.8e-05",
                     "1, 1, 0, 0, 1, 1, 1, 1, 1, 1, 1, 1"),
              HasSubstr("12 coefficients"));
}

// ------------------------------------------------------- cameras and images

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
                             std::string(kKalibr).find("pinhole"), 7, "omni"));
  EXPECT_THAT(LoadError({"cam0/1.png"}),
              AllOf(HasSubstr("line 2"), HasSubstr("'omni'")));
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

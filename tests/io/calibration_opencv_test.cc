// SPDX-License-Identifier: BSD-3-Clause
// OpenCV, ROS, camodocal, and EuRoC, which share the syntax of YAML 1.0.
#include "io/calibration_fixture.h"

namespace mgsfm {
namespace {

using testing::AllOf;
using testing::ElementsAre;
using testing::HasSubstr;

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

// RTAB-Map writes the format of ROS with cv::FileStorage (CameraModel::save,
// StereoCameraModel::save).
TEST_F(CalibrationTest, RtabMapStereoPair) {
  std::string right = kRos;
  right.replace(right.find("right"), 5, "zed_right");
  std::string left = right;
  left.replace(left.find("right"), 5, "left");
  left.replace(left.find("-48"), 3, "0");
  const std::string header = "%YAML:1.0\n---\n";
  Write("calib/zed_left.yaml", header + left);
  Write("calib/zed_right.yaml", header + right);
  Write("calib/zed_pose.yaml",
        header +
            "camera_name: zed\nrotation_matrix:\n   rows: 3\n   cols: 3\n"
            "   data: [ 1., 0., 0., 0., 1., 0., 0., 0., 1. ]\n");
  const Cameras cameras = ReadCalibration(Path("calib"));
  ASSERT_EQ(cameras.size(), 2u);
  EXPECT_THAT(cameras[0].names, ElementsAre("zed_left", "zed_left", "left"));
  EXPECT_THAT(cameras[1].names, ElementsAre("zed_right", "zed_right", "right"));
  EXPECT_NEAR(CamFromFirst(cameras, 1).translation.norm(), 0.12, 1e-12);
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
  EXPECT_EQ(mirror[0].model, CameraModelId::kThinPrismFisheye);
  const double difference_px =
      MaxDifference(mirror[0],
                    {{1336.3220825849971, 1335.7883350012958},
                     {716.94323510126321, 705.76498308221585},
                     2.213404750785489,
                     0.0,
                     {0.016798235660113681, 1.6548773243373522,
                      4.2223943394772046e-04, 4.2462134260997584e-04}},
                    105.0);
  EXPECT_LT(difference_px, 0.3);
  EXPECT_LT(difference_px, mirror[0].fit_error_px.value() + 1e-3);
}

TEST_F(CalibrationTest, MalformedYamlNamesLineAndRemedy) {
  EXPECT_THAT(ErrorOfChange("s.yaml", kEuroc, "intrinsics:", "other:"),
              AllOf(HasSubstr("s.yaml', line 3"),
                    HasSubstr("lacks the key 'intrinsics'")));
  EXPECT_THAT(ErrorOfChange("s.yaml", kEuroc, "0.0, 0.0, 0.0, 1.0]", "0.0]"),
              AllOf(HasSubstr("line 7"), HasSubstr("13 numbers")));
  EXPECT_THAT(ErrorOfChange("r.yaml", kRos, "[430.15, 0,", "[430.15,"),
              AllOf(HasSubstr("line 5"), HasSubstr("8 numbers; give 9")));
  EXPECT_THAT(ErrorOfChange("r.yaml", kRos, "[0, -1, 0, 1", "[0, -1, 0, 2"),
              AllOf(HasSubstr("line 14"), HasSubstr("not a rotation")));
  EXPECT_THAT(ErrorOfChange("f.yaml", kMei, "   xi:", "   yi:"),
              AllOf(HasSubstr("f.yaml', line 8"), HasSubstr("'xi'")));
  EXPECT_THAT(ErrorOfChange("m.yaml", kKannalaBrandt, "   mu:", "   nu:"),
              AllOf(HasSubstr("line 8"), HasSubstr("'mu'")));
}

}  // namespace
}  // namespace mgsfm

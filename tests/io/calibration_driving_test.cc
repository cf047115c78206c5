// SPDX-License-Identifier: BSD-3-Clause
// Data sets of vehicles: KITTI, KITTI-360, nuScenes and Argoverse 1.
#include <regex>

#include "io/calibration_fixture.h"

namespace mgsfm {
namespace {

using testing::AllOf;
using testing::ElementsAre;
using testing::HasSubstr;

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

TEST_F(CalibrationTest, KittiOdometry) {
  const Cameras cameras = ReadCalibration(Write("calib.txt", kKittiOdometry));
  ASSERT_EQ(cameras.size(), 3u);
  for (const char* separator : {":", ":\t"}) {
    const std::string text = std::regex_replace(std::string(kKittiOdometry),
                                                std::regex(": "), separator);
    const Cameras same = ReadCalibration(Write("other.txt", text));
    ASSERT_EQ(same.size(), 3u);
    EXPECT_EQ(same[2].names, cameras[2].names);
  }
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
  EXPECT_NEAR(
      (cameras[0].cam_from_base->Center() - Eigen::Vector3d(0.7, 1.1, 1.0))
          .norm(),
      0.0, 1e-12);
  EXPECT_EQ(cameras[0].model, CameraModelId::kThinPrismFisheye);
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

TEST_F(CalibrationTest, MalformedDataSetsNameLineAndRemedy) {
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

}  // namespace
}  // namespace mgsfm

// SPDX-License-Identifier: BSD-3-Clause
// Camera chains of Kalibr.
#include "io/calibration_fixture.h"

namespace mgsfm {
namespace {

using testing::AllOf;
using testing::ElementsAre;
using testing::HasSubstr;

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

// A panorama head: the rotations are known.
TEST_F(CalibrationTest, CamerasAtOnePlaceKeepTheirRotations) {
  std::string text = kKalibr;
  for (const std::string length : {"-0.11", "0.5"}) {
    text.replace(text.find(length + "]"), length.size(), "0.0");
  }
  const Cameras cameras = ReadCalibration(Write("camchain.yaml", text));
  Eigen::Matrix3d rotation;
  rotation << 0, 0, -1, 0, 1, 0, 1, 0, 0;
  ExpectPose(CamFromFirst(cameras, 2), rotation, {0.0, 0.0, 0.0});
}

TEST_F(CalibrationTest, KalibrWithPartOfAChain) {
  std::string text = kKalibr;
  const auto remove = [&] {
    text.replace(text.find("T_cn_cnm1"), 9, "T_unknown");
    return ReadCalibration(Write("camchain.yaml", text));
  };
  const Cameras part = remove();
  EXPECT_FALSE(part[0].cam_from_base.has_value());
  Eigen::Matrix3d rotation;
  rotation << 0, 0, -1, 0, 1, 0, 1, 0, 0;
  ExpectPose(*part[2].cam_from_base * part[1].cam_from_base->Inverse(),
             rotation, {0.5, 0.0, 0.0});
  for (const CalibratedCamera& camera : remove()) {
    EXPECT_FALSE(camera.cam_from_base.has_value());
  }
}

TEST_F(CalibrationTest, MalformedChainsNameLineAndRemedy) {
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
  EXPECT_THAT(ErrorOfChange("a.yaml", kKalibr, "  resolution: [752, 480]",
                            "  resolution: [752, 480]\n"
                            "  resolution: [376, 240]"),
              AllOf(HasSubstr("line 8"), HasSubstr("'resolution'"),
                    HasSubstr("twice")));
}

// The chain continues after a gap that the inertial sensor closes, or does not.
TEST_F(CalibrationTest, GapsOfChainsAreClosedByTheInertialSensor) {
  const auto camera = [](int i, const std::string& poses) {
    return "cam" + std::to_string(i) +
           ":\n  camera_model: pinhole\n  distortion_model: none\n"
           "  intrinsics: [400, 400, 320, 240]\n"
           "  resolution: [640, 480]\n" +
           poses;
  };
  const auto pose = [](const std::string& key, double x_m) {
    return "  " + key + ": [[1, 0, 0, " + std::to_string(x_m) +
           "], [0, 1, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1]]\n";
  };
  const std::string first = camera(0, pose("T_cam_imu", 0.5));
  const std::string last = camera(2, pose("T_cn_cnm1", 0.25));
  const Cameras cameras = ReadCalibration(
      Write("closed.yaml", first + camera(1, pose("T_cam_imu", 0.7)) + last));
  // 0.7 - 0.5, and 0.25 more.
  EXPECT_NEAR(CamFromFirst(cameras, 1).translation.x(), 0.2, 1e-12);
  EXPECT_NEAR(CamFromFirst(cameras, 2).translation.x(), 0.45, 1e-12);
  const std::string open = Write("open.yaml", first + camera(1, "") + last);
  EXPECT_THAT(
      ErrorOf([&] { (void)ReadCalibration(open); }),
      AllOf(HasSubstr("open.yaml"), HasSubstr("cam1"), HasSubstr("T_cn_cnm1")));
}

constexpr char kLens[] =
    "  camera_model: pinhole\n  distortion_model: none\n"
    "  intrinsics: [300, 300, 319.5, 119.5]\n  resolution: [640, 240]\n";

// Two cameras with both statements of their poses; `imu` and `chain` are the
// x coordinates of cam1_from_imu and cam1_from_cam0.
std::string WithBothPoses(const std::string& imu, const std::string& chain) {
  const auto matrix = [](const std::string& x) {
    return "[[1,0,0," + x + "],[0,1,0,0],[0,0,1,0],[0,0,0,1]]\n";
  };
  return std::string("cam0:\n") + kLens + "  T_cam_imu: " + matrix("0.3") +
         "cam1:\n" + kLens + "  T_cam_imu: " + matrix(imu) +
         "  T_cn_cnm1: " + matrix(chain);
}

TEST_F(CalibrationTest, BothPosesOfKalibrMustAgree) {
  const Cameras cameras =
      ReadCalibration(Write("a.yaml", WithBothPoses("-0.2", "-0.501")));
  ExpectPose(CamFromFirst(cameras, 1), Eigen::Matrix3d::Identity(),
             {-0.501, 0.0, 0.0});
  EXPECT_THAT(ErrorOfFile("a.yaml", WithBothPoses("-0.2", "0.5")),
              AllOf(HasSubstr("line 8"), HasSubstr("T_cam_imu"),
                    HasSubstr("-0.5 0 0, not 0.5 0 0")));
}

TEST_F(CalibrationTest, TransposedMatricesAreRefused) {
  EXPECT_THAT(ErrorOfChange("a.yaml", kKalibr, "- [0.0, 0.0, 0.0, 1.0]",
                            "- [-0.11, 0.0, 0.0, 1.0]"),
              AllOf(HasSubstr("line 11"), HasSubstr("0 0 0 1")));
}

TEST_F(CalibrationTest, IntrinsicsThatNoLensHasAreRefused) {
  const auto expect = [&](const char* before, const char* after,
                          const char* problem) {
    EXPECT_THAT(ErrorOfChange("a.yaml", kKalibr, before, after),
                AllOf(HasSubstr("a.yaml', line"), HasSubstr("'cam0'"),
                      HasSubstr(problem)));
  };
  expect("458.6, 457.3", "0.36, 3.6e7", "focal length");
  expect("367.2, 248.4", "-6000, 248.4", "principal point");
  expect("[-0.28, 0.07,", "[-44.9, 1017,", "cannot be inverted");
  expect("367.2, 248.4", "183.6, 124.2", "368 x 249");
}

TEST_F(CalibrationTest, LensesWithoutModelHaveAReason) {
  const auto reason = [&](const std::string& before, const std::string& after) {
    std::string text = kKalibr;
    text.replace(text.find(before), before.size(), after);
    return ReadCalibration(Write("a.yaml", text))[0].why_no_model;
  };
  EXPECT_EQ(reason("pinhole", "pinhole"), "");
  EXPECT_THAT(reason("pinhole", "other"), HasSubstr("'other'"));
  EXPECT_THAT(reason("-0.28, 0.07, 0.0002, 1.8e-05", "-0.28, 0.07, 0.0002"),
              AllOf(HasSubstr("3 coefficients"), HasSubstr("give k1 k2 p1")));
  EXPECT_THAT(reason("radtan", "other"), HasSubstr("'other'"));
  EXPECT_THAT(reason("-0.28, 0.07, 0.0002, 1.8e-05",
                     "1, 1, 0, 0, 1, 1, 1, 1, 1, 1, 1, 1"),
              HasSubstr("12 coefficients"));
}

// A camera of Kalibr with other lines for its lens.
std::string WithLens(const std::string& lens) {
  return "cam0:\n" + lens + "  resolution: [752, 480]\n";
}

TEST_F(CalibrationTest, UnifiedLenses) {
  const MirrorLens lens{{300.0, 301.0}, {370.0, 245.0}, 0.9, 0.0, {0, 0, 0, 0}};
  const Cameras exact = ReadCalibration(Write(
      "a.yaml", WithLens("  camera_model: omni\n  distortion_model: none\n"
                         "  intrinsics: [0.9, 300.0, 301.0, 370.0, 245.0]\n")));
  EXPECT_EQ(exact[0].model, CameraModelId::kEucm);
  EXPECT_FALSE(exact[0].fit_error_px.has_value());
  EXPECT_LT(MaxDifference(exact[0], lens, 100.0), 1e-9);
  const MirrorLens distorted{
      {700.0, 701.0}, {370.0, 245.0}, 1.6, 0.0, {-0.1, 0.05, 0.0, 0.0}};
  const Cameras fitted = ReadCalibration(Write(
      "a.yaml", WithLens("  camera_model: omni\n  distortion_model: radtan\n"
                         "  distortion_coeffs: [-0.1, 0.05, 0.0, 0.0]\n"
                         "  intrinsics: [1.6, 700.0, 701.0, 370.0, 245.0]\n")));
  EXPECT_EQ(fitted[0].model, CameraModelId::kOpenCVFisheye);
  EXPECT_LT(MaxDifference(fitted[0], distorted, 90.0), 0.1);
}

TEST_F(CalibrationTest, DoubleSpheres) {
  const MirrorLens lens{
      {160.0, 161.0}, {370.0, 245.0}, -0.2, 0.58, {0, 0, 0, 0}};
  const Cameras cameras = ReadCalibration(Write(
      "a.yaml",
      WithLens("  camera_model: ds\n  distortion_model: none\n"
               "  intrinsics: [-0.2, 0.58, 160.0, 161.0, 370.0, 245.0]\n")));
  EXPECT_EQ(cameras[0].model, CameraModelId::kOpenCVFisheye);
  EXPECT_LT(MaxDifference(cameras[0], lens, 100.0), 0.5);
}

TEST_F(CalibrationTest, LensesThatNoModelApproximatesHaveAReason) {
  EXPECT_THAT(
      ReadCalibration(Write(
          "a.yaml",
          WithLens("  camera_model: omni\n  distortion_model: radtan\n"
                   "  distortion_coeffs: [-0.1, 0.05, 0.0, 0.0]\n"
                   "  intrinsics: [0.9, 300.0, 301.0, 370.0, 245.0]\n")))[0]
          .why_no_model,
      HasSubstr("approximate only within"));
  EXPECT_THAT(
      ReadCalibration(Write(
          "a.yaml",
          WithLens("  camera_model: omni\n  distortion_model: equidistant\n"
                   "  intrinsics: [0.9, 300.0, 301.0, 370.0, 245.0]\n")))[0]
          .why_no_model,
      HasSubstr("omni with equidistant"));
}

}  // namespace
}  // namespace mgsfm

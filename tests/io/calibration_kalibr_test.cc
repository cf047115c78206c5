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

TEST_F(CalibrationTest, KalibrWithoutChain) {
  std::string text = kKalibr;
  text.replace(text.find("T_cn_cnm1"), 9, "T_unknown");
  const Cameras cameras = ReadCalibration(Write("camchain.yaml", text));
  for (const CalibratedCamera& camera : cameras) {
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

}  // namespace
}  // namespace mgsfm

// SPDX-License-Identifier: BSD-3-Clause
#include "priors/body_calibration.h"

#include <gmock/gmock.h>

#include "io/test_database.h"
#include "mgsfm/priors/pose_priors.h"
#include "support/temp_dir.h"

namespace mgsfm {
namespace {

using Eigen::Vector3d;
using testing::AllOf;
using testing::HasSubstr;

// The first camera looks along the x axis of the body, 2 m ahead of its
// origin, and the second one is 0.5 m to its right.
constexpr const char* kCamchain = R"(cam0:
  rostopic: /left/image_raw
  T_cam_imu: [[0, -1, 0, 0], [0, 0, -1, 0], [1, 0, 0, -2], [0, 0, 0, 1]]
cam1:
  T_cn_cnm1: [[1, 0, 0, -0.5], [0, 1, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1]]
antenna_in_imu: [0.5, 0.0, 1.2]
)";

class BodyCalibrationTest : public testing::Test {
 protected:
  BodyCalibrationTest() {
    scene_ = LoadScene(MakeContents({"left/1.png", "left/2.png", "right1/1.png",
                                     "right1/2.png"}),
                       {}, Context())
                 .scene;
    Write("camchain.yaml", kCamchain);
    options_.ref_images_path =
        Write("positions.txt", "left/1.png 1 2 3\nright1/2.png 4 5 6\n");
  }
  std::string Write(const std::string& name, const std::string& text) {
    path_ = (dir_.path() / name).string();
    WriteTextFile(path_, text);
    return path_;
  }
  std::string ErrorWith(const std::string& name, const std::string& text) {
    options_.body_calibration = Write(name, text);
    return ErrorOf(
        [&] { (void)ReadPositionPriors(scene_, "in.db", options_); });
  }

  const TempDir dir_;
  Scene scene_;
  std::string path_;
  PosePriorOptions options_;
};

// The antenna is 1.5 m behind and 1.2 m above the first camera.
TEST_F(BodyCalibrationTest, PositionsAreThoseOfTheAntenna) {
  options_.body_calibration = Write("camchain.yaml", kCamchain);
  const PositionPriors priors = ReadPositionPriors(scene_, "in.db", options_);
  EXPECT_EQ(priors.images[0]->position, Vector3d(1.0, 2.0, 3.0));
  EXPECT_LT((priors.images[0]->cam_from_antenna.translation -
             Vector3d(0.0, -1.2, -1.5))
                .norm(),
            1e-12);
  EXPECT_LT((priors.images[3]->cam_from_antenna.translation -
             Vector3d(-0.5, -1.2, -1.5))
                .norm(),
            1e-12);
  EXPECT_LT((priors.images[3]->cam_from_antenna.rotation * Vector3d::UnitX() -
             Vector3d::UnitZ())
                .norm(),
            1e-12);
}

TEST_F(BodyCalibrationTest, GravityIsThatOfTheInertialSensor) {
  options_.body_calibration = Write("camchain.yaml", kCamchain);
  options_.gravity_path = Write("gravity.txt", "left/1.png 0 0 -9.81\n");
  const GravityPriors gravity = ReadGravity(scene_, "in.db", options_);
  EXPECT_LT((*gravity.images[0] - Vector3d::UnitY()).norm(), 1e-12);
}

// JSON is YAML, and a camera follows from the known rig.
TEST_F(BodyCalibrationTest, KnownRigsCompleteAndMustAgree) {
  const std::string json =
      "{\"left\": {\"T_cam_imu\": [[1, 0, 0, 0.1], [0, 1, 0, 0], [0, 0, 1, 0], "
      "[0, 0, 0, 1]]}}";
  EXPECT_THAT(
      ErrorWith("body.json", json),
      AllOf(HasSubstr("no pose of camera 'right1'"), HasSubstr("1/2.png")));
  const int right = scene_.images[2].sensor_idx;
  scene_.sensors[right].sensor_from_rig =
      Rigid3{Eigen::Quaterniond::Identity(), {-0.4, 0.0, 0.0}};
  EXPECT_EQ(ErrorWith("body.json", json), "no error");
  const Body body = ReadBody(scene_, path_);
  EXPECT_LT((body.cam_from_body[right]->translation - Vector3d(-0.3, 0.0, 0.0))
                .norm(),
            1e-12);
  EXPECT_TRUE(body.antenna_in_body.isZero(0.0));
  EXPECT_THAT(ErrorWith("camchain.yaml", kCamchain),
              AllOf(HasSubstr("camera 'right1' relative to 'left'"),
                    HasSubstr("correct one of them")));
}

TEST_F(BodyCalibrationTest, OtherFormatsAreRefusedByName) {
  EXPECT_THAT(ErrorWith("robot.urdf", "<robot/>"),
              AllOf(HasSubstr("is a URDF"), HasSubstr("T_cam_imu")));
  EXPECT_THAT(ErrorWith("tf.yaml", "transforms: []\n"),
              HasSubstr("dump of tf"));
  EXPECT_THAT(ErrorWith("drive.mcap", ""), HasSubstr("is a recording"));
  EXPECT_THAT(ErrorWith("rig.json", "[]"), HasSubstr("is no map"));
  EXPECT_THAT(ErrorWith("chain.yaml", "cam0: {resolution: [1, 1]}\n"),
              HasSubstr("no camera with T_cam_imu"));
}

TEST_F(BodyCalibrationTest, WrongValuesNameTheRemedy) {
  const std::string pose =
      "{T_cam_imu: [[1, 0, 0, 0], [0, 1, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1]]}\n";
  EXPECT_THAT(ErrorWith("b.yaml", "top: " + pose + "rear: " + pose),
              AllOf(HasSubstr("none of the cameras 'left', 'right1'"),
                    HasSubstr("rename")));
  EXPECT_THAT(ErrorWith("b.yaml", "cam0: " + pose + "antenna_in_imu: [1, 2]\n"),
              HasSubstr("line 2"));
  EXPECT_THAT(
      ErrorWith("b.yaml", "cam0: " + pose + "antenna_in_imu: [1, 2, .inf]\n"),
      HasSubstr("finite"));
  options_ = PosePriorOptions();
  EXPECT_THAT(ErrorWith("camchain.yaml", kCamchain),
              HasSubstr("would not be read"));
}

}  // namespace
}  // namespace mgsfm

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
  const BodyFrame body = ReadBody(scene_, path_);
  EXPECT_LT((body.cam_from_body[right]->translation - Vector3d(-0.3, 0.0, 0.0))
                .norm(),
            1e-12);
  EXPECT_TRUE(body.antenna_in_body.isZero(0.0));
  EXPECT_THAT(ErrorWith("camchain.yaml", kCamchain),
              AllOf(HasSubstr("camera 'right1' relative to 'left'"),
                    HasSubstr("correct one of them")));
}

TEST_F(BodyCalibrationTest, OtherFormatsAreRefusedByName) {
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

// The body of kCamchain. In an optical frame, x of the base is z, y is -x, and
// z is -y: a roll of -90 and then a yaw of -90 degrees about fixed axes.
constexpr const char* kUrdf = R"(<?xml version="1.0"?>
<!-- <joint type="fixed"> of an old robot -->
<![CDATA[ <joint> ]]>
<robot name="car">
  <link name="maximum_link"/>
  <link name="base_link"/> <link name='imu_link'/> <link name="left"></link>
  <link name="left_optical_frame"/> <link name="right1"/>
  <link name="gnss_antenna"/> <link name="wheel1"/>
  <joint name="a" type="fixed">
    <origin xyz="1
    0 0.5"/><parent link="base_link"/><child link="imu_link"/>
  </joint>
  <joint name="b" type="fixed">
    <parent link="base_link"/><child link="left"/><origin xyz="3 0 0.5"/>
  </joint>
  <joint name="c" type="fixed">
    <origin rpy="-1.5707963267948966 0 -1.5707963267948966" xyz="0 0 0"/>
    <parent link="left"/><child link="left_optical_frame"/>
  </joint>
  <joint name="d" type="fixed">
    <origin xyz="0.5 0 0"/>
    <parent link="left_optical_frame"/><child link="right1"/>
  </joint>
  <joint name="e" type="fixed">
    <origin xyz="0.5 0 1.2"/>
    <parent link="imu_link"/><child link="gnss_antenna"/>
  </joint>
  <joint name="f" type="continuous">
    <parent link="base_link"/><child link="wheel1"/><axis xyz="0 1 0"/>
  </joint>
  <transmission name="t"><joint name="f"><origin/></joint></transmission>
</robot>
)";

std::string With(std::string text, const std::string& part,
                 const std::string& other) {
  return text.replace(text.find(part), part.size(), other);
}

TEST_F(BodyCalibrationTest, AUrdfIsTheSameBody) {
  const BodyFrame expected = ReadBody(scene_, Write("chain.yaml", kCamchain));
  Write("robot.urdf", With(kUrdf, "old robot", "old robot in Latin-1: \xe9"));
  // Other names need a file that says what they are.
  Write("other.urdf", With(With(kUrdf, "name=\"wheel1", "name=\"imu_2"),
                           "name=\"base_link", "name=\"gps_base"));
  const std::string named =
      Write("body.yaml",
            "urdf: other.urdf\nimu_link: imu_link\nantenna_link: gnss_antenna");
  for (const std::string& path :
       {(dir_.path() / "robot.urdf").string(), named}) {
    const BodyFrame body = ReadBody(scene_, path);
    EXPECT_LT((body.antenna_in_body - expected.antenna_in_body).norm(), 1e-12);
    for (size_t s = 0; s < scene_.sensors.size(); ++s) {
      const Rigid3 difference =
          *body.cam_from_body[s] * expected.cam_from_body[s]->Inverse();
      EXPECT_LT(difference.translation.norm(), 1e-12) << path;
      EXPECT_LT(difference.rotation.vec().norm(), 1e-12) << path;
    }
  }
}

TEST_F(BodyCalibrationTest, ErrorsOfUrdfsListTheLinks) {
  const auto error = [&](const std::string& part, const std::string& other) {
    return ErrorWith("robot.urdf", With(kUrdf, part, other));
  };
  EXPECT_EQ(error("car", "bus"), "no error");
  EXPECT_THAT(error("\"wheel1", "\"imu_2"),
              AllOf(HasSubstr("robot.urdf"), HasSubstr("imu_link, imu_2"),
                    HasSubstr("set imu_link")));
  EXPECT_THAT(error("'imu_link", "'sensor"),
              AllOf(HasSubstr("base_link, sensor"), HasSubstr("set imu_link")));
  EXPECT_THAT(error("\"wheel1", "\"gps"), HasSubstr("gnss_antenna, gps"));
  EXPECT_THAT(error("e\" type=\"fixed", "e\" type=\"prismatic"),
              HasSubstr("no fixed joints connect"));
  EXPECT_THAT(error("xyz=\"1", "xyz=\"${x}"),
              AllOf(HasSubstr("joint 'a'"), HasSubstr("xyz")));
  EXPECT_THAT(error("xyz=\"1", "xyz=\"1e300"),
              AllOf(HasSubstr("joint 'a'"), HasSubstr("correct it")));
  EXPECT_THAT(error("<transmission", "<xacro:wheel name=\"f\"/><transmission"),
              HasSubstr("has macros"));
  EXPECT_THAT(error("</robot>", ""), HasSubstr("no whole URDF"));
  EXPECT_THAT(error("robot -->", ""), HasSubstr("comment without end"));
  EXPECT_THAT(error("]]>", ""), HasSubstr("CDATA without end"));
  EXPECT_THAT(error("<parent link=\"base_link\"/><child link=\"left\"",
                    "<parent link=\"right1\"/><child link=\"left\""),
              HasSubstr("has a cycle of fixed joints above the link 'left'"));
  EXPECT_THAT(error("d\" type=\"fixed", "d\" type=\"floating"),
              AllOf(HasSubstr("no pose of camera 'right1'"),
                    HasSubstr("fixed joints to its link")));
  Write("robot.urdf", kUrdf);
  EXPECT_THAT(ErrorWith("body.yaml", "urdf: robot.urdf\nantenna_link: roof"),
              AllOf(HasSubstr("no link 'roof' (antenna_link)"),
                    HasSubstr("gnss_antenna, wheel1")));
  EXPECT_THAT(ErrorWith("body.yaml", "urdf: robot.urdf\nimu_lnk: imu_link"),
              AllOf(HasSubstr("body.yaml', line 2"), HasSubstr("imu_lnk"),
                    HasSubstr("is none of urdf")));
  EXPECT_THAT(ErrorWith("body.yaml",
                        "urdf: robot.urdf\nantenna_in_imu: [0, 0, 1]\n"
                        "antenna_link: gnss_antenna"),
              HasSubstr("is beside antenna_link"));
}

// The time is linear in the length of a chain, which is read within the limit
// of tests; 20,000 links would take a minute otherwise.
TEST_F(BodyCalibrationTest, ChainsOfAUrdfMayBeLong) {
  constexpr int kNumJoints = 20'000;
  std::string text = "<robot><link name='imu'/><link name='end_gnss'/>";
  std::string parent = "imu";
  for (int i = 1; i <= kNumJoints; ++i) {
    const std::string child =
        i == kNumJoints ? "end_gnss" : "link" + std::to_string(i);
    if (i < kNumJoints) text += "<link name='" + child + "'/>";
    text += "<joint type='fixed'><origin xyz='0.5 0 0'/><parent link='" +
            parent + "'/><child link='" + child + "'/></joint>";
    parent = child;
  }
  Write("robot.urdf", text +
                          "<link name='cam_optical_frame'/><joint type='"
                          "fixed'><parent link='end_gnss'/><child link="
                          "'cam_optical_frame'/></joint></robot>");
  const Scene scene =
      LoadScene(MakeContents({"1.png", "2.png"}), {}, Context()).scene;
  const BodyFrame body = ReadBody(scene, (dir_.path() / "robot.urdf").string());
  EXPECT_NEAR(body.antenna_in_body.x(), 0.5 * kNumJoints, 1e-6);
  EXPECT_NEAR(body.cam_from_body[0]->translation.x(), -0.5 * kNumJoints, 1e-6);
}

TEST_F(BodyCalibrationTest, OneSensorHasTheOpticalLinkAndAnyAntenna) {
  Write("robot.urdf", kUrdf);
  const Scene scene =
      LoadScene(MakeContents({"1.png", "2.png"}), {}, Context()).scene;
  const BodyFrame body = ReadBody(
      scene,
      Write("body.yaml", "urdf: robot.urdf\nantenna_in_imu: [0, 0, 1]\n"));
  EXPECT_EQ(body.antenna_in_body, Vector3d::UnitZ());
  EXPECT_EQ(body.warning, "");
  const BodyFrame both = ReadBody(scene_, path_);
  EXPECT_EQ(body.cam_from_body[0]->translation,
            both.cam_from_body[0]->translation);
  EXPECT_THAT(both.warning, AllOf(HasSubstr("the link 'right1'"),
                                  HasSubstr("right1_optical_frame")));
}

}  // namespace
}  // namespace mgsfm

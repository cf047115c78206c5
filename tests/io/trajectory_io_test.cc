// SPDX-License-Identifier: BSD-3-Clause
#include "mgsfm/models/trajectory_io.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "io/test_database.h"
#include "support/temp_dir.h"

namespace mgsfm {
namespace {

namespace fs = std::filesystem;
using testing::AllOf;
using testing::HasSubstr;

// cos and sin of a turn about z with short decimals.
constexpr double kCos = 0.6, kSin = 0.8;

class TrajectoryIo : public testing::Test {
 protected:
  fs::path Put(const std::string& text) const {
    WriteTextFile(path_, text);
    return path_;
  }
  const TempDir dir_;
  const fs::path path_ = dir_.path() / "poses.txt";
};

TEST_F(TrajectoryIo, ReadsKittiPoses) {
  const std::vector<Rigid3> poses =
      ReadKittiPoses(Put("1 0 0 0 0 1 0 0 0 0 1 0\n"
                         "0.6 -0.8 0 1e0 0.8 0.6 0 -2 0 0 1 3.5\r\n\n"));
  ASSERT_EQ(poses.size(), 2u);
  EXPECT_EQ(poses[0].translation, Eigen::Vector3d::Zero());
  EXPECT_LT((poses[1].Center() - Eigen::Vector3d(1.0, -2.0, 3.5)).norm(),
            1e-12);
  const Eigen::Vector3d x_in_world =
      poses[1].Inverse().rotation * Eigen::Vector3d::UnitX();
  EXPECT_LT((x_in_world - Eigen::Vector3d(kCos, kSin, 0.0)).norm(), 1e-12);
}

TEST_F(TrajectoryIo, NamesFileAndLineOfBadKittiPoses) {
  const std::string good = "1 0 0 0 0 1 0 0 0 0 1 0\n";
  for (const char* bad :
       {"1 0 0 0 0 1 0 0 0 0 1", "1 0 0 0 0 1 0 0 0 0 1 0 0",
        "1 0 0 0 0 1 0 x 0 0 1 0", "2 0 0 0 0 1 0 0 0 0 1 0",
        "-1 0 0 0 0 1 0 0 0 0 1 0", "nan 0 0 0 0 1 0 0 0 0 1 0",
        "1 0 0 nan 0 1 0 0 0 0 1 0", "1 0 0 inf 0 1 0 0 0 0 1 0",
        "1 0 0 0 0 1 0 0 0 0 1 0 end", "1 0 0 0 0 1 0 0 0 0 1 0x"}) {
    Put(good + bad + "\n");
    EXPECT_THAT(ErrorOf([&] { ReadKittiPoses(path_); }),
                AllOf(HasSubstr(path_.string()), HasSubstr("line 2")))
        << bad;
  }
  EXPECT_THAT(ErrorOf([&] { ReadKittiPoses(dir_.path() / "none"); }),
              HasSubstr("none"));
}

TEST_F(TrajectoryIo, ReadsTumPoses) {
  const std::vector<TimedPose> poses =
      ReadTumPoses(Put("# timestamp tx ty tz qx qy qz qw\n"
                       "1403636580.763555527 1 -2 3.5 0 0 0.4472136 0.8944272\n"
                       "\n1403636581 0 0 0 0 0 0 -1\n"));
  ASSERT_EQ(poses.size(), 2u);
  EXPECT_EQ(poses[0].timestamp_s, 1403636580.763555527);
  const Rigid3& pose = poses[0].cam_from_world;
  EXPECT_LT((pose.Center() - Eigen::Vector3d(1.0, -2.0, 3.5)).norm(), 1e-12);
  const Eigen::Vector3d x_in_world =
      pose.Inverse().rotation * Eigen::Vector3d::UnitX();
  EXPECT_LT((x_in_world - Eigen::Vector3d(kCos, kSin, 0.0)).norm(), 1e-6);
  EXPECT_NEAR(pose.rotation.norm(), 1.0, 1e-15);
}

TEST_F(TrajectoryIo, NamesFileAndLineOfBadTumPoses) {
  for (const char* bad :
       {"1 0 0 0 0 0 0", "1 0 0 0 0 0 0 1 0", "1 0 0 0 0 0 0 0",
        "1 0 0 0 0 0 0 2", "1,0,0", "1 0 0 0 0 0 0 1 end", "nan 0 0 0 0 0 0 1",
        "1 0 nan 0 0 0 0 1", "1 0 0 0 nan 0 0 1"}) {
    Put(std::string("0 0 0 0 0 0 0 1\n") + bad + "\n");
    EXPECT_THAT(ErrorOf([&] { ReadTumPoses(path_); }),
                AllOf(HasSubstr(path_.string()), HasSubstr("line 2")))
        << bad;
  }
}

TEST_F(TrajectoryIo, TimesOfTumAreSeconds) {
  EXPECT_THAT(
      ErrorOf([&] { ReadTumPoses(Put("1403636579763 0 0 0 0 0 0 1\n")); }),
      AllOf(HasSubstr("line 1"), HasSubstr("seconds")));
}

// An empty field must not shift the others.
TEST_F(TrajectoryIo, FieldsOfEurocMayNotBeEmpty) {
  const std::string pose = "1403636579763555584,1,2,3,1,0,0,0";
  const std::string rest = ",0.1,0.2,0.3,0.4,0.5\n";
  const auto poses = ReadEurocPoses(Put("#timestamp\r\n" + pose + rest));
  ASSERT_EQ(poses.size(), 1u);
  EXPECT_NEAR(poses[0].timestamp_s, 1403636579.763555584, 1e-6);
  EXPECT_LT(
      (poses[0].cam_from_world.Center() - Eigen::Vector3d(1, 2, 3)).norm(),
      1e-12);
  for (const char* bad :
       {"1403636579763555584,,2,3,1,0,0,0", "1403636579.7,1,2,3,1,0,0,0",
        "1403636579763555584,1,2,3,0.9,0,0,0", "1403636579763555584,1,2,3,1",
        "1403636579763555584,1,2,3,1,0,0,0,x"}) {
    EXPECT_THAT(ErrorOf([&] { ReadEurocPoses(Put(bad + rest)); }),
                HasSubstr("line 1"))
        << bad;
  }
}

TEST_F(TrajectoryIo, ReadsKittiCalibration) {
  const std::vector<Rigid3> cameras =
      ReadKittiCalibration(Put("calib_time: 09-Jan-2012 13:57:47\n"
                               "P0: 700 0 600 0 0 700 180 0 0 0 1 0\n"
                               "P1: 700 0 600 -378 0 700 180 0 0 0 1 0\n"
                               "P2: 700 0 600 43.5 0 700 180 0.7 0 0 1 0.0025\n"
                               "R0_rect: 1 0 0 0 1 0 0 0 1\n"));
  ASSERT_EQ(cameras.size(), 3u);
  EXPECT_LT(cameras[0].translation.norm(), 1e-12);
  EXPECT_LT((cameras[1].translation - Eigen::Vector3d(-0.54, 0.0, 0.0)).norm(),
            1e-12);
  EXPECT_LT((cameras[2].translation -
             Eigen::Vector3d(0.06, (0.7 - 0.45) / 700.0, 0.0025))
                .norm(),
            1e-12);
  EXPECT_THAT(ErrorOf([&] {
                ReadKittiCalibration(
                    Put("P0: 700 0 600 0 0 700 180 0 0 0 1 0\n"
                        "P1: 700 0 600 x 0 700 180 0 0 0 1 0\n"));
              }),
              HasSubstr("line 2"));
  EXPECT_THAT(ErrorOf([&] { ReadKittiCalibration(Put("nothing: 1 2 3\n")); }),
              HasSubstr(path_.string()));
  EXPECT_THAT(ErrorOf([&] {
                ReadKittiCalibration(Put("P0: 0 0 0 0 0 0 0 0 0 0 0 0\n"));
              }),
              HasSubstr("line 1"));
}

TEST_F(TrajectoryIo, CamerasOfKittiAreInTheOrderOfTheirNames) {
  const std::vector<Rigid3> cameras =
      ReadKittiCalibration(Put("P1: 700 0 600 -378 0 700 180 0 0 0 1 0\n"
                               "P0: 700 0 600 0 0 700 180 0 0 0 1 0\n"));
  EXPECT_LT(cameras.at(0).translation.norm(), 1e-12);
  EXPECT_NEAR(cameras.at(1).translation.x(), -0.54, 1e-12);
}

TEST_F(TrajectoryIo, ReadsEurocCalibration) {
  const std::string before = "sensor_type: camera\nT_BS:\n  cols: 4\n";
  const Rigid3 sensor_from_body = ReadEurocCalibration(
      Put(before +
          "  rows: 4\n  data: [0.6, -0.8, 0.0, 1.0,\n"
          "         0.8, 0.6, 0.0, -2.0,\n         0.0, 0.0, 1.0, 3.5,\n"
          "         0.0, 0.0, 0.0, 1.0]\nrate_hz: 20\n"));
  EXPECT_LT(
      (sensor_from_body.Center() - Eigen::Vector3d(1.0, -2.0, 3.5)).norm(),
      1e-12);
  EXPECT_LT((sensor_from_body.Inverse().rotation * Eigen::Vector3d::UnitX() -
             Eigen::Vector3d(kCos, kSin, 0.0))
                .norm(),
            1e-12);
  for (const std::string& bad :
       {std::string("rate_hz: 20\n"), before, before + "  data: [1, 0, 0]\n",
        before + "  rows: 4\n  data: [2,0,0,0,0,1,0,0,0,0,1,0,0,0,0,1]\n"}) {
    EXPECT_THAT(ErrorOf([&] { ReadEurocCalibration(Put(bad)); }),
                AllOf(HasSubstr(path_.string()), HasSubstr("T_BS")))
        << bad;
  }
  EXPECT_THAT(
      ErrorOf([&] { ReadEurocCalibration(Put(before + "  data: [1, 0")); }),
      AllOf(HasSubstr(path_.string()), HasSubstr("line")));
  // What is commented out is no matrix.
  EXPECT_THAT(ErrorOf([&] {
                ReadEurocCalibration(
                    Put("# T_BS: {rows: 4, cols: 4, data: [1,0,0,0,0,1,0,0,"
                        "0,0,1,0,0,0,0,1]}\nrate_hz: 20\n"));
              }),
              HasSubstr("T_BS"));
}

TEST_F(TrajectoryIo, TimesAreInOrderAndDiffer) {
  const std::string pose = " 1 2 3 0 0 0 1\n";
  const auto poses = ReadTumPoses(Put("2" + pose + "1" + pose + "2" + pose));
  ASSERT_EQ(poses.size(), 2u);
  EXPECT_EQ(poses[0].timestamp_s, 1.0);
  EXPECT_EQ(poses[1].timestamp_s, 2.0);
  EXPECT_THAT(
      ErrorOf([&] { ReadTumPoses(Put("2" + pose + "2 1 2 4 0 0 0 1\n")); }),
      AllOf(HasSubstr(path_.string()), HasSubstr("2.0"),
            HasSubstr("two different poses")));
}

}  // namespace
}  // namespace mgsfm

// SPDX-License-Identifier: BSD-3-Clause
// Positions and gravity by time.
#include <gmock/gmock.h>

#include <cmath>

#include "geometry/geodetic.h"
#include "io/test_database.h"
#include "mgsfm/priors/pose_priors.h"
#include "support/temp_dir.h"

namespace mgsfm {
namespace {

using testing::AllOf;
using testing::HasSubstr;

// Images every 0.1 s from 100 s on.
class TimedPriorsTest : public testing::Test {
 protected:
  TimedPriorsTest() {
    std::vector<std::string> names;
    for (int i = 10; i < 30; ++i) {
      names.push_back("cam0/" + std::to_string(i) + ".png");
    }
    scene_ = LoadScene(MakeContents(names), {}, Context()).scene;
    for (size_t i = 0; i < scene_.images.size(); ++i) {
      scene_.images[i].timestamp_s = 100.0 + 0.1 * static_cast<double>(i);
    }
  }
  void Write(const std::string& name, const std::string& text) {
    WriteTextFile(dir_.path() / name, text);
    options_.ref_images_path = (dir_.path() / name).string();
  }
  PositionPriors Positions() const {
    return MakePositionPriors(scene_, {}, "in.db", options_);
  }
  std::string ErrorOfCsv(const std::string& text,
                         const std::string& columns = "") {
    Write("log.csv", text);
    options_.ref_columns = columns;
    return ErrorOf([&] { (void)Positions(); });
  }
  // A drive of constant velocity at 5 Hz on a clock that is ahead, from 1 s
  // before the first image on; `name_columns` comes first.
  static std::string Drive(const std::string& name_columns, double ahead_s,
                           double unit_s) {
    std::string text = name_columns + "\n";
    for (int i = 0; i < 16; ++i) {
      const double time_s = 99.0 + 0.2 * i;
      text += std::to_string((time_s + ahead_s) / unit_s) + ",ok," +
              std::to_string(2000.0 + 3.0 * time_s) + "," +
              std::to_string(-2.0 * time_s) + ",7," +
              std::to_string(0.1 * (1 + i % 2)) + ",0.2,0.3\n";
    }
    return text;
  }
  void ExpectOnDrive(const PositionPriors& priors) const {
    for (size_t i = 0; i < priors.images.size(); ++i) {
      ASSERT_TRUE(priors.images[i].has_value()) << i;
      const double time_s = *scene_.images[i].timestamp_s;
      EXPECT_NEAR((priors.images[i]->position -
                   Eigen::Vector3d(2000.0 + 3.0 * time_s, -2.0 * time_s, 7.0))
                      .norm(),
                  0.0, 1e-4);
    }
  }

  const TempDir dir_;
  Scene scene_;
  PosePriorOptions options_;
};

TEST_F(TimedPriorsTest, ColumnsAreNamedOrMapped) {
  Write("log.csv", Drive("time,fix,x,y,z,std_x,std_y,std_z", 0.0, 1.0));
  ExpectOnDrive(Positions());
  Write("log.txt", Drive("# t, fix, \"east, m\",north,up,a,b,c", 0.0, 1e-3));
  options_.ref_columns = "time_ms=t,x=3,y=north,z=up";
  ExpectOnDrive(Positions());
  EXPECT_NEAR(Positions().images[0]->covariance(0, 0), 1.0, 1e-12);
}

TEST_F(TimedPriorsTest, TheClockMayBeAhead) {
  Write("log.csv", Drive("time,fix,x,y,z,std_x,std_y,std_z", 0.12, 1.0));
  options_.prior_clock_offset_s = 0.12;
  ExpectOnDrive(Positions());
  options_.prior_clock_offset_s = 1000.0;
  EXPECT_THAT(ErrorOf([&] { (void)Positions(); }),
              AllOf(HasSubstr("no value at the time of any image"),
                    HasSubstr("99.120 to 102.120 s")));
}

// Between two measurements, the variance is not below that of the best mean of
// independent ones, and not above the larger one.
TEST_F(TimedPriorsTest, CovariancesAreInterpolated) {
  Write("log.csv", Drive("time,fix,x,y,z,std_x,std_y,std_z", 0.0, 1.0));
  const PositionPriors priors = Positions();
  for (const auto& measurement : priors.images) {
    const double variance = measurement->covariance(0, 0);
    EXPECT_GE(variance, 0.01 * 0.04 / (0.01 + 0.04) - 1e-9);
    EXPECT_LE(variance, 0.04 + 1e-9);
    EXPECT_NEAR(measurement->covariance(1, 1), 0.04, 1e-9);
    EXPECT_NEAR(measurement->covariance(0, 1), 0.0, 1e-12);
  }
  EXPECT_NEAR(priors.images[0]->covariance(0, 0), 0.04, 1e-6);
  EXPECT_NEAR(priors.images[1]->covariance(0, 0), 0.025, 1e-6);
}

TEST_F(TimedPriorsTest, GapsAndFixesAtZeroAreRespected) {
  std::string text = "time,latitude,longitude,altitude\n";
  for (int i = 0; i < 40; ++i) {
    if (i >= 10 && i < 25) continue;  // 16 intervals
    const bool has_fix = i != 30;
    text +=
        std::to_string(99.9 + 0.05 * i) + "," +
        (has_fix ? "48." + std::to_string(10000 + i) + ",11.5,500" : "0,0,0") +
        "\n";
  }
  Write("log.csv", text);
  const PositionPriors priors = Positions();
  ASSERT_TRUE(priors.origin_wgs84.has_value());
  for (size_t i = 0; i < priors.images.size(); ++i) {
    const double time_s = *scene_.images[i].timestamp_s;
    const bool is_in_gap = time_s > 100.36 && time_s < 101.14;
    const bool is_known = !is_in_gap && time_s < 101.86;
    ASSERT_EQ(priors.images[i].has_value(), is_known) << i;
    if (!is_known) continue;
    const Eigen::Vector3d wgs84(48.1 + 1e-5 * (time_s - 99.9) / 0.05, 11.5,
                                500.0);
    EXPECT_LT(
        (priors.images[i]->position - EastNorthUp(wgs84, *priors.origin_wgs84))
            .norm(),
        0.01);
  }
}

TEST_F(TimedPriorsTest, EurocFilesAreDetected) {
  Write("data.csv",
        "#timestamp [ns],p_x,p_y,p_z,q_w,q_x,q_y,q_z\n"
        "99000000000,3,0,0,1,0,0,0\n103000000000,7,0,0,1,0,0,0\n");
  const PositionPriors priors = Positions();
  EXPECT_NEAR(priors.images[0]->position.x(), 4.0, 1e-9);
  EXPECT_NEAR(priors.images[10]->position.x(), 5.0, 1e-9);
}

TEST_F(TimedPriorsTest, GravityByTimeIsThatOfTheReferenceCamera) {
  options_.gravity_path = (dir_.path() / "imu.txt").string();
  std::string text = "# SECONDS GX GY GZ\n";
  for (int i = 0; i <= 40; ++i) {
    const double angle_rad = 0.01 * i;
    text += std::to_string(99.9 + 0.06 * i) + " " +
            std::to_string(9.81 * std::sin(angle_rad)) + " " +
            std::to_string(9.81 * std::cos(angle_rad)) + " 0\n";
  }
  WriteTextFile(*options_.gravity_path, text);
  const GravityPriors gravity = ReadGravity(scene_, "", options_);
  for (size_t i = 0; i < gravity.images.size(); ++i) {
    ASSERT_TRUE(gravity.images[i].has_value());
    EXPECT_NEAR(gravity.images[i]->norm(), 1.0, 1e-9);
    const double angle_rad =
        0.01 * (*scene_.images[i].timestamp_s - 99.9) / 0.06;
    EXPECT_NEAR(std::atan2(gravity.images[i]->x(), gravity.images[i]->y()),
                angle_rad, 1e-5);
  }
  WriteTextFile(*options_.gravity_path, text + "103 0 0 0\n");
  EXPECT_THAT(ErrorOf([&] { (void)ReadGravity(scene_, "", options_); }),
              HasSubstr("is zero"));
}

// Whichever camera has an image, the axes of the file are those of the
// reference camera, here cam0. A rotation by 90 degrees about z turns its x to
// y of cam1.
TEST_F(TimedPriorsTest, GravityOfFramesWithoutTheReferenceCamera) {
  const auto load = [](const std::vector<std::string>& names) {
    return LoadScene(MakeContents(names), {}, Context()).scene;
  };
  Scene scene = load({"cam0/1.png", "cam0/2.png", "cam1/1.png", "cam1/3.png"});
  for (size_t i = 0; i < scene.images.size(); ++i) {
    scene.images[i].timestamp_s = scene.images[i].name[5] - '0';
  }
  options_.gravity_path = (dir_.path() / "imu.txt").string();
  WriteTextFile(*options_.gravity_path, "0 1 0 0\n1 1 0 0\n3 1 0 0\n");
  const auto read = [&] { return ReadGravity(scene, "", options_).images; };
  const auto with_unknown_pose = read();
  EXPECT_EQ(with_unknown_pose[1], Eigen::Vector3d::UnitX());
  EXPECT_FALSE(with_unknown_pose[2].has_value());
  EXPECT_FALSE(with_unknown_pose[3].has_value());
  Sensor& cam1 = scene.sensors[scene.images[3].sensor_idx];
  cam1.sensor_from_rig = Rigid3{
      Eigen::Quaterniond(Eigen::AngleAxisd(M_PI / 2, Eigen::Vector3d::UnitZ())),
      Eigen::Vector3d(1.0, 2.0, 3.0)};
  const auto with_pose = read();
  EXPECT_EQ(with_pose[1], Eigen::Vector3d::UnitX());
  ASSERT_TRUE(with_pose[3].has_value());
  EXPECT_LT((*with_pose[3] - Eigen::Vector3d::UnitY()).norm(), 1e-12);
  cam1.sensor_from_rig.reset();
  WriteTextFile(*options_.gravity_path, "2.5 1 0 0\n3.5 1 0 0\n");
  EXPECT_THAT(ErrorOf([&] { (void)read(); }),
              AllOf(HasSubstr("imu.txt"), HasSubstr("rig_config_path"),
                    HasSubstr("body_calibration")));
}

TEST_F(TimedPriorsTest, ProblemsOfCsvFilesAreNamed) {
  const std::string rows = "100,1,2,3\n101,2,3,4\n102,3,4,5\n";
  EXPECT_THAT(ErrorOfCsv("t,x,y,z\n" + rows),
              AllOf(HasSubstr("no column is the time"),
                    HasSubstr("columns are 't', 'x', 'y', 'z'")));
  EXPECT_THAT(ErrorOfCsv("time,x,y,h\n" + rows), HasSubstr("only some of 'x'"));
  EXPECT_THAT(ErrorOfCsv("time,a,b,c\n" + rows), HasSubstr("the position"));
  EXPECT_THAT(ErrorOfCsv("time,x,y,z\n" + rows, "x=9"),
              HasSubstr("no column '9'"));
  EXPECT_THAT(ErrorOfCsv("time,x,y,z\n" + rows, "lat=x"),
              HasSubstr("'lat' is no key"));
  EXPECT_THAT(ErrorOfCsv("time,x,y,z\n" + rows, "time_ns=time"),
              HasSubstr("several columns are times"));
  EXPECT_THAT(ErrorOfCsv("time,x,y,z\n" + rows + "103,a,1,1\n"),
              AllOf(HasSubstr("line 5"), HasSubstr("'a' in column 2")));
  EXPECT_THAT(ErrorOfCsv("time,x,y,z\n" + rows + "101,1,1,1\n"),
              HasSubstr("101.000000000 s twice"));
  EXPECT_THAT(ErrorOfCsv(""), HasSubstr("no line with the names of columns"));
}

}  // namespace
}  // namespace mgsfm

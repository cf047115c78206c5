// SPDX-License-Identifier: BSD-3-Clause
#include "mgsfm/priors/pose_priors.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <sqlite3.h>

#include <cmath>
#include <limits>

#include "geometry/geodetic.h"
#include "io/test_database.h"
#include "mgsfm/database/feature_database.h"
#include "mgsfm/models/scene_loading.h"
#include "priors/position_files.h"
#include "support/temp_dir.h"

namespace mgsfm {
namespace {

using CoordinateSystem = PosePriorRow::CoordinateSystem;
using testing::AllOf;
using testing::HasSubstr;

constexpr double kNaN = std::numeric_limits<double>::quiet_NaN();

class PosePriorsTest : public testing::Test {
 protected:
  PosePriorsTest()
      : scene_(LoadScene(MakeContents({"a b/0.png", "a b/1.png", "a b/2.png"}),
                         {}, Context())
                   .scene) {
    options_.use_prior_position = true;
  }

  std::string Path(const std::string& name) const {
    return (dir_.path() / name).string();
  }
  PosePriorRow Row(int image_idx, CoordinateSystem system,
                   const Eigen::Vector3d& position) const {
    return {scene_.images[image_idx].id, system, position, std::nullopt};
  }
  PositionPriors Make(const std::vector<PosePriorRow>& rows) const {
    return MakePositionPriors(scene_, rows, "in.db", options_);
  }
  std::string ErrorOfRows(const std::vector<PosePriorRow>& rows) const {
    return ErrorOf([&] { (void)Make(rows); });
  }
  std::string ErrorOfFile(const std::string& text) {
    options_.ref_images_path = Path("positions.txt");
    WriteTextFile(*options_.ref_images_path, text);
    return ErrorOfRows({});
  }

  const TempDir dir_;
  const Scene scene_;
  PosePriorOptions options_;
};

TEST_F(PosePriorsTest, AreOnlyUsedIfAskedFor) {
  options_.use_prior_position = false;
  EXPECT_TRUE(
      Make({Row(0, CoordinateSystem::kCartesian, {kNaN, 0.0, 0.0})}).IsEmpty());
}

TEST_F(PosePriorsTest, GpsIsEastNorthUpOfTheFirstImage) {
  const Eigen::Vector3d origin(49.0, 8.4, 100.0), other(49.001, 8.401, 103.0);
  const PositionPriors priors =
      Make({Row(2, CoordinateSystem::kWgs84, other),
            Row(1, CoordinateSystem::kWgs84, origin)});
  ASSERT_EQ(priors.images.size(), 3u);
  EXPECT_FALSE(priors.images[0].has_value());
  EXPECT_EQ(*priors.origin_wgs84, origin);
  EXPECT_LT(priors.images[1]->position.norm(), 1e-9);
  EXPECT_EQ(priors.images[2]->position, EastNorthUp(other, origin));
}

// Receivers write zeros without a fix.
TEST_F(PosePriorsTest, FixesAtZeroAreLeftOutAndCounted) {
  const Eigen::Vector3d origin(49.0, 8.4, 100.0), none(0.0, 0.0, 0.0);
  const PositionPriors priors =
      Make({Row(0, CoordinateSystem::kWgs84, none),
            Row(1, CoordinateSystem::kWgs84, origin)});
  EXPECT_FALSE(priors.images[0].has_value());
  EXPECT_EQ(*priors.origin_wgs84, origin);
  EXPECT_EQ(priors.num_null_fixes, 1);
  EXPECT_THAT(ErrorOfRows({Row(0, CoordinateSystem::kWgs84, none)}),
              HasSubstr("no positions"));
  // The origin of a Cartesian frame is a position.
  EXPECT_TRUE(
      Make({Row(0, CoordinateSystem::kCartesian, none)}).images[0].has_value());
}

TEST_F(PosePriorsTest, CovariancesAreGivenOrThoseOfTheOptions) {
  options_.prior_position_std_z_m = 3.0;
  PosePriorRow given = Row(0, CoordinateSystem::kCartesian, {1.0, 2.0, 3.0});
  given.covariance = 4.0 * Eigen::Matrix3d::Identity();
  const auto missing = Row(1, CoordinateSystem::kCartesian, {1.0, 2.0, 3.0});
  const Eigen::Matrix3d by_options =
      Eigen::Vector3d(1.0, 1.0, 9.0).asDiagonal();
  PositionPriors priors = Make({given, missing});
  EXPECT_FALSE(priors.origin_wgs84.has_value());
  EXPECT_EQ(priors.images[0]->position, Eigen::Vector3d(1.0, 2.0, 3.0));
  EXPECT_EQ(priors.images[0]->covariance, *given.covariance);
  EXPECT_EQ(priors.images[1]->covariance, by_options);
  options_.overwrite_priors_covariance = true;
  EXPECT_EQ(Make({given}).images[0]->covariance, by_options);
}

TEST_F(PosePriorsTest, NamesWhatIsWrong) {
  PosePriorRow singular = Row(0, CoordinateSystem::kCartesian, {1.0, 2.0, 3.0});
  singular.covariance = Eigen::Matrix3d::Zero();
  EXPECT_THAT(ErrorOfRows({singular}),
              AllOf(HasSubstr("'a b/0.png'"), HasSubstr("positive definite")));
  EXPECT_THAT(
      ErrorOfRows({Row(1, CoordinateSystem::kCartesian, {kNaN, 0.0, 0.0})}),
      AllOf(HasSubstr("in.db"), HasSubstr("'a b/1.png'"),
            HasSubstr("not finite")));
  EXPECT_THAT(
      ErrorOfRows({Row(1, CoordinateSystem::kWgs84, {5430000.0, 4.0, 0.0})}),
      HasSubstr("not a latitude"));
  EXPECT_THAT(
      ErrorOfRows({Row(0, CoordinateSystem::kWgs84, {49.0, 8.0, 0.0}),
                   Row(1, CoordinateSystem::kCartesian, {49.0, 8.0, 0.0})}),
      HasSubstr("partly"));
  EXPECT_THAT(ErrorOfRows({}), HasSubstr("no positions"));
}

// GPS is in meters, so that a rig of that length cannot be in meters, too.
TEST_F(PosePriorsTest, RigsInMillimetersContradictGps) {
  SceneLoadingOptions loading;
  loading.rig_config_path = Path("rig.json");
  WriteTextFile(*loading.rig_config_path,
                R"([{"cameras": [{"image_prefix": "a/", "ref_sensor": true},
      {"image_prefix": "b/", "cam_from_rig_rotation": [1, 0, 0, 0],
       "cam_from_rig_translation": [-540, 0, 0]}]}])");
  const Scene scene =
      LoadScene(MakeContents({"a/0.png", "b/0.png"}), loading, Context()).scene;
  const auto make = [&](CoordinateSystem system) {
    return ErrorOf([&] {
      (void)MakePositionPriors(
          scene,
          {{scene.images[0].id, system, {49.0, 8.0, 100.0}, std::nullopt}},
          "in.db", options_);
    });
  };
  EXPECT_THAT(
      make(CoordinateSystem::kWgs84),
      AllOf(HasSubstr("in.db"), HasSubstr("540"), HasSubstr("millimeters")));
  EXPECT_EQ(make(CoordinateSystem::kCartesian), "no error");
}

TEST_F(PosePriorsTest, ReadsFiles) {
  options_.ref_images_path = Path("positions.txt");
  WriteTextFile(*options_.ref_images_path,
                "# name X Y Z\na b/2.png 1.5 -2 3e1\r\n\na b/0.png 1 1 1\n");
  const PositionPriors priors = Make({});
  EXPECT_EQ(priors.images[2]->position, Eigen::Vector3d(1.5, -2.0, 30.0));
  EXPECT_EQ(priors.images[0]->position, Eigen::Vector3d::Ones());
  EXPECT_FALSE(priors.images[1].has_value());
  options_.ref_is_gps = PositionKind::kGps;
  EXPECT_EQ(*Make({}).origin_wgs84, Eigen::Vector3d::Ones());
}

// A degree is 100 km, and recordings are far from (0, 0).
TEST_F(PosePriorsTest, RangeTellsDegreesFromLengths) {
  const auto are_gps = [](const std::vector<Eigen::Vector3d>& positions) {
    return AreGps(positions, PositionKind::kAuto, "'a.txt'");
  };
  EXPECT_TRUE(are_gps({{48.1, 11.5, 500.0}, {48.1001, 11.5002, 501.0}}));
  EXPECT_TRUE(are_gps({{-33.9, 151.2, 5.0}, {0.0, 0.0, 0.0}}));
  EXPECT_TRUE(are_gps({{48.1, 11.5, 500.0}, {48.4, 11.6, 560.0}}));
  // An object of 0.3 m: 30 km without a difference in height are improbable.
  EXPECT_THAT(ErrorOf([&] {
                are_gps({{48.1, 11.5, 0.0}, {48.4, 11.6, 0.1}});
              }),
              HasSubstr("ref_is_gps"));
  EXPECT_FALSE(are_gps({{0.0, 0.0, 0.0}, {0.3, 0.0, 0.1}, {0.6, 0.1, 0.0}}));
  EXPECT_FALSE(are_gps({{-30.0, 0.0, 0.0}, {50.0, 80.0, 1.0}}));
  EXPECT_FALSE(
      are_gps({{691607.2, 5334760.1, 515.0}, {691608.0, 5334761.0, 5}}));
  const std::vector<Eigen::Vector3d> in_radians = {{0.8395, 0.2007, 500.0},
                                                   {0.8396, 0.2007, 501.0}};
  EXPECT_THAT(ErrorOf([&] { are_gps(in_radians); }), HasSubstr("radians"));
  EXPECT_TRUE(AreGps(in_radians, PositionKind::kGps, ""));
  EXPECT_THAT(ErrorOf([&] {
                are_gps({{50.0, 60.0, 0.0}, {52.0, 61.0, 0.0}});
              }),
              AllOf(HasSubstr("'a.txt'"), HasSubstr("ref_is_gps")));
  EXPECT_TRUE(
      AreGps({{50.0, 60.0, 0.0}, {52.0, 61.0, 0.0}}, PositionKind::kGps, ""));
}

TEST_F(PosePriorsTest, NamesTheLineThatIsWrong) {
  EXPECT_THAT(ErrorOfFile("a b/0.png 1 2\n"), HasSubstr("line 1"));
  EXPECT_THAT(ErrorOfFile("a.png 1 2\n"),
              HasSubstr("line 1: expected 'image_name X Y Z'"));
  EXPECT_THAT(ErrorOfFile("\n c.png 1 2 3\n"),
              AllOf(HasSubstr("line 2"), HasSubstr("'c.png'")));
  EXPECT_THAT(ErrorOfFile("a b/0.png 1 2 3\na b/0.png 1 2 3\n"),
              AllOf(HasSubstr("line 2"), HasSubstr("again")));
  EXPECT_THAT(ErrorOfFile("a b/0.png 1 2 3x\n"), HasSubstr("'3x'"));
  EXPECT_THAT(ErrorOfFile("a b/0.png 1 nan 3\n"), HasSubstr("finite number"));
  options_.ref_images_path = Path("none.txt");
  EXPECT_THAT(ErrorOfRows({}), HasSubstr("cannot be read"));
}

TEST_F(PosePriorsTest, DatabaseKeepsThem) {
  PositionPriors priors;
  priors.images.resize(3);
  priors.images[1] = PositionMeasurement{
      {1.0, 2.0, 3.0}, Eigen::Vector3d(1.0, 2.0, 3.0).asDiagonal()};
  const DatabaseContents contents =
      MakeContents({"a b/0.png", "a b/1.png", "a b/2.png"});
  for (const auto schema : {DatabaseSchema::k38, DatabaseSchema::k312}) {
    const std::string path =
        Path(schema == DatabaseSchema::k38 ? "38.db" : "312.db");
    WriteDatabase(path, contents, schema);
    EXPECT_THAT(
        ErrorOf([&] { (void)ReadPositionPriors(scene_, path, options_); }),
        HasSubstr("no positions"));
    {
      FeatureDatabase database(path, FeatureDatabase::OpenMode::kExisting);
      for (const PosePriorRow& row : MakePosePriorRows(scene_, priors)) {
        database.WritePosePrior(row);
      }
    }
    const PositionPriors read = ReadPositionPriors(scene_, path, options_);
    EXPECT_EQ(read.images[1]->position, priors.images[1]->position);
    EXPECT_EQ(read.images[1]->covariance, priors.images[1]->covariance);
  }
}

TEST_F(PosePriorsTest, GravityIsReadAndWritten) {
  WriteTextFile(Path("gravity.txt"),
                "# name GX GY GZ\na b/2.png 0 9.81 0\r\n\na b/0.png 3 0 -4\n");
  options_.gravity_path = Path("gravity.txt");
  const GravityPriors gravity = ReadGravity(scene_, "", options_);
  ASSERT_EQ(gravity.images.size(), 3u);
  EXPECT_EQ(*gravity.images[2], Eigen::Vector3d::UnitY());
  EXPECT_LT((*gravity.images[0] - Eigen::Vector3d(0.6, 0.0, -0.8)).norm(),
            1e-15);
  EXPECT_FALSE(gravity.images[1].has_value());
  WriteGravity(Path("copy.txt"), scene_, gravity);
  options_.gravity_path = Path("copy.txt");
  const GravityPriors copy = ReadGravity(scene_, "", options_);
  EXPECT_LT((*copy.images[0] - *gravity.images[0]).norm(), 1e-15);
  EXPECT_TRUE(ReadGravity(scene_, "", {}).IsEmpty());
}

void Execute(const std::string& path, const std::string& statement) {
  sqlite3* database = nullptr;
  ASSERT_EQ(sqlite3_open(path.c_str(), &database), SQLITE_OK);
  EXPECT_EQ(
      sqlite3_exec(database, statement.c_str(), nullptr, nullptr, nullptr),
      SQLITE_OK);
  sqlite3_close(database);
}

// The table of COLMAP 3.13.
TEST_F(PosePriorsTest, GravityOfTheDatabase) {
  options_.use_prior_gravity = true;
  const std::string path = Path("in.db");
  WriteDatabase(path, MakeContents({"a b/0.png", "a b/1.png", "a b/2.png"}),
                DatabaseSchema::k312);
  const auto error = [&] {
    return ErrorOf([&] { (void)ReadGravity(scene_, path, options_); });
  };
  EXPECT_THAT(error(), HasSubstr("no directions of gravity"));
  const std::string id = std::to_string(scene_.images[1].id.value());
  Execute(path,
          "ALTER TABLE pose_priors ADD COLUMN gravity BLOB; "
          "INSERT INTO pose_priors (image_id, coordinate_system, gravity) "
          "VALUES (" +
              id +
              ", -1, X'0000000000000000"
              "00000000000000400000000000000000');");
  const GravityPriors gravity = ReadGravity(scene_, path, options_);
  EXPECT_EQ(*gravity.images[1], Eigen::Vector3d::UnitY());
  EXPECT_FALSE(gravity.images[0].has_value());
  Execute(path, "UPDATE pose_priors SET gravity = zeroblob(24);");
  EXPECT_THAT(error(), HasSubstr("is zero"));
}

// The table of COLMAP 4. Rows of other sensors may have the id of an image.
TEST_F(PosePriorsTest, GravityOfColmap4) {
  options_.use_prior_gravity = true;
  const std::string path = Path("in.db");
  WriteDatabase(path, MakeContents({"a b/0.png", "a b/1.png", "a b/2.png"}),
                DatabaseSchema::k312);
  const auto insert = [&](size_t image, int sensor_type, const char* gravity) {
    return "INSERT INTO pose_priors (corr_data_id, corr_sensor_id, "
           "corr_sensor_type, gravity, coordinate_system) VALUES (" +
           std::to_string(scene_.images[image].id.value()) + ", 1, " +
           std::to_string(sensor_type) + ", X'" + gravity + "', -1);";
  };
  const char* const kAlongY =
      "0000000000000000"
      "0000000000000040"
      "0000000000000000";
  const char* const kAlongZ =
      "0000000000000000"
      "0000000000000000"
      "000000000000F0BF";
  Execute(path,
          "DROP TABLE IF EXISTS pose_priors; CREATE TABLE pose_priors "
          "(pose_prior_id INTEGER PRIMARY KEY NOT NULL, corr_data_id INTEGER "
          "NOT NULL, corr_sensor_id INTEGER NOT NULL, corr_sensor_type INTEGER "
          "NOT NULL, position BLOB, position_covariance BLOB, gravity BLOB, "
          "coordinate_system INTEGER NOT NULL);" +
              insert(2, 1, kAlongZ) + insert(1, 0, kAlongY) +
              insert(2, 0, kAlongZ) + insert(0, 1, kAlongY));
  const GravityPriors gravity = ReadGravity(scene_, path, options_);
  EXPECT_FALSE(gravity.images[0].has_value());
  EXPECT_EQ(*gravity.images[1], Eigen::Vector3d::UnitY());
  EXPECT_EQ(*gravity.images[2], Eigen::Vector3d(-Eigen::Vector3d::UnitZ()));
}

TEST_F(PosePriorsTest, GravityFilesNeedADirectionPerLine) {
  options_.gravity_path = Path("gravity.txt");
  const auto error = [&](const std::string& text) {
    WriteTextFile(Path("gravity.txt"), text);
    return ErrorOf([&] { (void)ReadGravity(scene_, "", options_); });
  };
  EXPECT_THAT(error("# name GX GY GZ\n"),
              AllOf(HasSubstr(Path("gravity.txt")),
                    HasSubstr("no line 'image_name GX GY GZ'")));
  EXPECT_THAT(error("a b/0.png 0 1 0\na b/1.png 0 0 0\n"),
              AllOf(HasSubstr("line 2"), HasSubstr("'a b/1.png'"),
                    HasSubstr("not all zero")));
}

TEST_F(PosePriorsTest, OriginsOfModelsRoundTrip) {
  EXPECT_FALSE(ReadGeoOrigin(dir_.path().string()).has_value());
  const std::string path = Path("geo_origin.json");
  const Eigen::Vector3d origin(-89.123456789012345, 179.5, 1e-3);
  WriteGeoOrigin(path, origin);
  EXPECT_EQ(ReadGeoOrigin(dir_.path().string()), origin);
  for (const auto& [text, remedy] :
       {std::pair("", "correct or delete it"),
        std::pair("[1, 2, 3]", "correct or delete it"),
        std::pair(R"({"latitude_deg": 1, "longitude_deg": 2})",
                  "correct or delete it"),
        std::pair(
            R"({"latitude_deg": 91, "longitude_deg": 2, "altitude_m": 3})",
            "is not a latitude"),
        std::pair(
            R"({"latitude_deg": 1, "longitude_deg": -361, "altitude_m": 3})",
            "is not a latitude")}) {
    WriteTextFile(path, text);
    EXPECT_THAT(ErrorOf([&] { (void)ReadGeoOrigin(dir_.path().string()); }),
                AllOf(HasSubstr(path), HasSubstr(remedy)))
        << text;
  }
}

// ------------------------------------------------------------ trajectories

TEST_F(PosePriorsTest, KittiTrajectoriesHaveALinePerFrame) {
  options_.ref_images_path = Path("poses.txt");
  WriteTextFile(*options_.ref_images_path,
                "1 0 0 1 0 1 0 2 0 0 1 3\n1 0 0 4 0 1 0 5 0 0 1 6\n"
                "0 -1 0 7 1 0 0 8 0 0 1 9\n");
  const PositionPriors priors = Make({});
  for (int i = 0; i < 3; ++i) {
    EXPECT_NEAR((priors.images[i]->position -
                 Eigen::Vector3d(3 * i + 1, 3 * i + 2, 3 * i + 3))
                    .norm(),
                0.0, 1e-12);
  }
  EXPECT_THAT(ErrorOfFile("1 0 0 1 0 1 0 2 0 0 1 3\n"),
              AllOf(HasSubstr("has 1 poses"), HasSubstr("3 frames")));
  EXPECT_THAT(ErrorOfFile("1 0 0 1 0 1 0 2 0 0 1 3\n2 0 0 1 0 1 0 2 0 0 1 3\n"),
              HasSubstr("line 2"));
}

// Positions are linear in time between poses, here of a constant velocity.
TEST_F(PosePriorsTest, TumTrajectoriesAreInterpolated) {
  const std::vector<std::string> names = {
      "cam0/1403636579.040000000.png", "cam0/1403636579.130000000.png",
      "cam0/1403636585.000000000.png", "cam1/1403636579.040000000.png",
      "cam1/1403636579.120000000.png"};
  const Scene scene = LoadScene(MakeContents(names), {}, Context()).scene;
  std::string text = "# timestamp tx ty tz qx qy qz qw\n";
  for (int i = 0; i <= 10; ++i) {
    text += "1403636579." + std::string(i < 5 ? "0" : "") +
            std::to_string(2 * i) + " " + std::to_string(i) + " 0 " +
            std::to_string(-2 * i) + " 0 0 0 1\n";
  }
  options_.ref_images_path = Path("poses.txt");
  WriteTextFile(*options_.ref_images_path, text + "1403636599 0 0 0 0 0 0 1\n");
  const PositionPriors priors =
      MakePositionPriors(scene, {}, "in.db", options_);
  EXPECT_NEAR(priors.images[0]->position.x(), 2.0, 1e-4);
  EXPECT_NEAR(priors.images[1]->position.x(), 6.5, 1e-4);
  EXPECT_NEAR(priors.images[1]->position.z(), -13.0, 1e-4);
  EXPECT_FALSE(priors.images[2].has_value());  // in a gap of 20 s
  EXPECT_FALSE(priors.images[3].has_value());  // not the reference sensor
  // A frame without an image of the reference sensor.
  EXPECT_NEAR(priors.images[4]->position.x(), 6.0, 1e-4);
  EXPECT_THAT(ErrorOfFile("1 0 0 0 0 0 0 1\n"), HasSubstr("has no time"));
}

// Of a receiver: along a meridian, whose degree has 111.2 km at this latitude.
TEST_F(PosePriorsTest, TumTrajectoriesMayBeGps) {
  const std::vector<std::string> names = {"cam0/1403636579.000000000.png",
                                          "cam0/1403636579.500000000.png"};
  const Scene scene = LoadScene(MakeContents(names), {}, Context()).scene;
  options_.ref_images_path = Path("fixes.txt");
  WriteTextFile(*options_.ref_images_path,
                "1403636579 49.0000 8.4 100 0 0 0 1\n"
                "1403636580 49.0002 8.4 100 0 0 0 1\n");
  EXPECT_FALSE(MakePositionPriors(scene, {}, "in.db", options_).origin_wgs84);
  options_.ref_is_gps = PositionKind::kGps;
  const PositionPriors priors =
      MakePositionPriors(scene, {}, "in.db", options_);
  ASSERT_TRUE(priors.images[1].has_value());
  EXPECT_NEAR(priors.images[1]->position.norm(), 11.12, 0.01);
}

// Times of images that a file gives go before those in their names; EuRoC
// counts them in nanoseconds.
TEST_F(PosePriorsTest, EurocTrajectoriesAreInterpolated) {
  const std::string path = Path("data.csv");
  WriteTextFile(path,
                "#timestamp [ns],p_x,p_y,p_z,q_w,q_x,q_y,q_z\n"
                "20000000000,3,0,0,0,0,0,1,9,9\n"
                "10000000000,1,0,0,1,0,0,0,9,9\n");
  Scene scene = scene_;
  const double times_s[] = {10.0, 15.0, 20.1};
  for (size_t i = 0; i < 3; ++i) scene.images[i].timestamp_s = times_s[i];
  const auto poses =
      ReadTrajectoryPoses(scene, path, PositionFileFormat::kEuroc);
  ASSERT_EQ(poses.size(), 2u);  // the last image is later than all
  for (size_t i = 0; i < 2; ++i) {
    const auto& [frame_idx, pose] = poses[i];
    EXPECT_EQ(frame_idx, static_cast<int>(i));
    EXPECT_LT((pose.Center() - Eigen::Vector3d(1.0 + i, 0.0, 0.0)).norm(),
              1e-12);
    EXPECT_NEAR(Eigen::AngleAxisd(pose.rotation).angle(), 0.5 * M_PI * i,
                1e-12);
  }
  for (Image& image : scene.images) *image.timestamp_s += 1000.0;
  EXPECT_THAT(ErrorOf([&] {
                (void)ReadTrajectoryPoses(scene, path,
                                          PositionFileFormat::kEuroc);
              }),
              AllOf(HasSubstr(path), HasSubstr("image_timestamps_path")));
}

}  // namespace
}  // namespace mgsfm

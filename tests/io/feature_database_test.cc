// SPDX-License-Identifier: BSD-3-Clause
#include "mgsfm/database/feature_database.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <filesystem>

#include "io/database_fixture.h"

namespace mgsfm {
namespace {

namespace fs = std::filesystem;
using testing::AllOf;
using testing::HasSubstr;

class FeatureDatabaseTest : public DatabaseTest {};

TEST_F(FeatureDatabaseTest, OpeningFailsWithARemedy) {
  using Mode = FeatureDatabase::OpenMode;
  const auto open = [](const std::string& path, Mode mode) {
    return ErrorOf([&] { FeatureDatabase(path, mode); });
  };
  SqliteDatabase::Create(Path("other.db")).Execute("CREATE TABLE notes (text)");
  fs::create_directory(Path("folder"));
  const auto before = FilesIn(dir_.path());
  EXPECT_THAT(open(Path("folder"), Mode::kOrCreate),
              HasSubstr("is a folder; choose a file in it"));
  EXPECT_THAT(open(Path("none.db"), Mode::kExisting),
              HasSubstr("run the feature extractor first"));
  EXPECT_THAT(open(Path("none/new.db"), Mode::kOrCreate),
              AllOf(HasSubstr("no folder '" + Path("none")),
                    HasSubstr("create it first")));
  EXPECT_THAT(open(Path("other.db"), Mode::kOrCreate),
              AllOf(HasSubstr("belongs to another program"),
                    HasSubstr("choose a new file")));
  EXPECT_THAT(open(Path(std::string(300, 'a')), Mode::kOrCreate),
              AllOf(HasSubstr("cannot be opened"), HasSubstr("permissions")));
  EXPECT_EQ(FilesIn(dir_.path()), before);
}

TEST_F(FeatureDatabaseTest, ErrorsOfSqliteHaveARemedy) {
  Write();
  SqliteDatabase database = SqliteDatabase::OpenReadWrite(Path(), Path());
  SqliteDatabase other = SqliteDatabase::OpenReadWrite(Path(), Path());
  other.Execute("BEGIN EXCLUSIVE");
  EXPECT_THAT(ErrorOf([&] { database.Execute("BEGIN IMMEDIATE"); }),
              AllOf(HasSubstr(Path()), HasSubstr("is in use"),
                    HasSubstr("wait until that has ended")));
  other.Execute("COMMIT");
  database.Execute("PRAGMA max_page_count = 1");
  EXPECT_THAT(ErrorOf([&] {
                database.Execute("CREATE TABLE big AS SELECT zeroblob(99999)");
              }),
              AllOf(HasSubstr(Path()), HasSubstr("free some space")));
  SqliteDatabase fixed = SqliteDatabase::OpenImmutable(Path(), Path());
  EXPECT_THAT(ErrorOf([&] { fixed.Execute("DELETE FROM images"); }),
              AllOf(HasSubstr("cannot be written"),
                    HasSubstr("check the permissions")));
  EXPECT_EQ(Read().images.size(), 4u);
}

// The tables of COLMAP before 3.4, which are brought up to date.
TEST_F(FeatureDatabaseTest, AncientTablesCanBeWritten) {
  Write();
  Execute(
      "ALTER TABLE two_view_geometries RENAME TO inlier_matches;"
      "ALTER TABLE inlier_matches DROP COLUMN qvec;"
      "ALTER TABLE inlier_matches DROP COLUMN tvec;"
      "ALTER TABLE inlier_matches DROP COLUMN E");
  const DatabaseContents before = Read();
  TwoViewGeometryRow pair = ContentsWithRig().pairs[0];
  {
    FeatureDatabase database(Path(), FeatureDatabase::OpenMode::kExisting);
    EXPECT_EQ(database.CountInlierMatches().size(), before.pairs.size());
    database.WriteTwoViewGeometry(pair);
  }
  const DatabaseContents after = Read();
  ASSERT_EQ(after.pairs.size(), before.pairs.size());
  EXPECT_EQ(after.pairs[0].E, pair.E);
  ExpectSamePose(after.pairs[0].cam2_from_cam1.value(), *pair.cam2_from_cam1);
  for (size_t i = 1; i < after.pairs.size(); ++i) {
    EXPECT_EQ(after.pairs[i].F, before.pairs[i].F);
    EXPECT_FALSE(after.pairs[i].E.has_value());
    ExpectSameMatches(after.pairs[i].matches, before.pairs[i].matches);
  }
}

// Missing tables are seen, but added to the file together with the first row.
TEST_F(FeatureDatabaseTest, OnlyAWriteChangesTheFile) {
  using Mode = FeatureDatabase::OpenMode;
  Write(DatabaseSchema::k38);
  const std::string before = ReadTextFile(Path());
  {
    FeatureDatabase database(Path(), Mode::kExisting);
    EXPECT_TRUE(database.ReadPosePriors().empty());
    EXPECT_THROW(
        {
          DatabaseTransaction transaction(&database);
          database.AddSingleImageFrame(ImageId(1), CameraId(1));
          throw Error("refused");
        },
        Error);
    EXPECT_TRUE(database.ReadPosePriors().empty());
  }
  EXPECT_TRUE(ReadTextFile(Path()) == before);
  { FeatureDatabase(Path("new.db"), Mode::kOrCreate); }
  EXPECT_FALSE(fs::exists(Path("new.db")));
  FeatureDatabase(Path(), Mode::kExisting)
      .AddSingleImageFrame(ImageId(1), CameraId(1));
  EXPECT_EQ(Read().frames.size(), 1u);
}

TEST_F(FeatureDatabaseTest, PairsMayBeGivenInEitherOrder) {
  Write(DatabaseSchema::k312);
  Execute("PRAGMA user_version = 4020000");  // absent values are NULL
  const TwoViewGeometryRow pair = ContentsWithRig().pairs[0];
  TwoViewGeometryRow swapped = pair;
  SwapImages(&swapped);
  FeatureDatabase database(Path(), FeatureDatabase::OpenMode::kExisting);
  database.DeleteTwoViewGeometries();
  EXPECT_FALSE(database.HasTwoViewGeometry(ImageId(1), ImageId(2)));
  database.WriteTwoViewGeometry(swapped);
  for (const bool is_swapped : {false, true}) {
    const ImageId id1(is_swapped ? 2 : 1), id2(is_swapped ? 1 : 2);
    const TwoViewGeometryRow& expected = is_swapped ? swapped : pair;
    const auto read = database.ReadTwoViewGeometry(id1, id2).value();
    EXPECT_EQ(read.image_id1, id1);
    EXPECT_EQ(read.F, expected.F);
    EXPECT_EQ(read.E, expected.E);
    EXPECT_TRUE(read.H->isApprox(*expected.H));
    ExpectSamePose(read.cam2_from_cam1.value(), *expected.cam2_from_cam1);
    ExpectSameMatches(read.matches, expected.matches);
  }
  swapped.cam2_from_cam1.reset();
  swapped.H.reset();
  database.WriteTwoViewGeometry(swapped);
  const auto read =
      database.ReadTwoViewGeometry(ImageId(1), ImageId(2)).value();
  EXPECT_EQ(read.F, pair.F);
  EXPECT_FALSE(read.H || read.cam2_from_cam1);
}

TEST_F(FeatureDatabaseTest, CountsAreThoseOfTheRows) {
  Write();
  Execute(
      "UPDATE keypoints SET rows = 0, data = NULL WHERE image_id = 2;"
      "DELETE FROM keypoints WHERE image_id = 3");
  FeatureDatabase database(Path(), FeatureDatabase::OpenMode::kReadOnly);
  const std::vector<std::pair<ImageId, size_t>> expected = {
      {ImageId(1), 20}, {ImageId(2), 0}, {ImageId(4), 20}};
  EXPECT_EQ(database.CountKeypoints(), expected);
  for (const PairCount& pair : database.CountMatches()) {
    EXPECT_LT(pair.image_id1, pair.image_id2);
    EXPECT_EQ(pair.num_matches, 12u);
  }
  EXPECT_EQ(database.CountMatches().size(), ContentsWithRig().pairs.size());
  for (const std::string id : {"2147483647 * 4 + 3", "-1"}) {
    Execute("UPDATE matches SET pair_id = " + id +
            " WHERE pair_id = (SELECT max(pair_id) FROM matches)");
    EXPECT_THAT(ErrorOf([&] {
                  (void)FeatureDatabase(Path(),
                                        FeatureDatabase::OpenMode::kReadOnly)
                      .CountMatches();
                }),
                AllOf(HasSubstr(Path()), HasSubstr("invalid pair id"),
                      HasSubstr("in the table matches")));
  }
}

// Rows of a scale and an orientation become affine shapes.
TEST_F(FeatureDatabaseTest, KeypointsOfFourColumnsHaveAScale) {
  Write();
  Execute(
      "UPDATE keypoints SET rows = 1, cols = 4, data = "
      "x'0000803f000000400000404000000000' WHERE image_id = 1");
  const std::vector<FeatureKeypoint> keypoints =
      FeatureDatabase(Path(), FeatureDatabase::OpenMode::kReadOnly)
          .ReadKeypoints(ImageId(1));
  ASSERT_EQ(keypoints.size(), 1u);
  EXPECT_EQ(keypoints[0].x_px, 1.0f);
  EXPECT_EQ(keypoints[0].y_px, 2.0f);
  EXPECT_FLOAT_EQ(keypoints[0].ScalePx(), 3.0f);
  EXPECT_FLOAT_EQ(keypoints[0].OrientationRad(), 0.0f);
}

TEST_F(FeatureDatabaseTest, FramesOfOneImageShareTheRigOfTheirCamera) {
  WriteDatabase(Path(), MakeContents(kNames), DatabaseSchema::k312);
  {
    FeatureDatabase database(Path(), FeatureDatabase::OpenMode::kExisting);
    for (uint32_t id = 1; id <= 4; ++id) {
      database.AddSingleImageFrame(ImageId(id), CameraId(id <= 2 ? 1 : 2));
    }
  }
  const DatabaseContents read = Read();
  ASSERT_EQ(read.rigs.size(), 2u);
  ASSERT_EQ(read.frames.size(), 4u);
  for (size_t i = 0; i < 4; ++i) {
    const RigRow& rig = read.rigs[i / 2];
    EXPECT_EQ(rig.ref_camera_id, CameraId(static_cast<uint32_t>(i / 2) + 1));
    EXPECT_EQ(read.frames[i].rig_id, rig.id);
    ASSERT_EQ(read.frames[i].data.size(), 1u);
    EXPECT_EQ(read.frames[i].data[0].image_id, read.images[i].id);
    EXPECT_EQ(read.frames[i].data[0].camera_id, read.images[i].camera_id);
  }
}

TEST_F(FeatureDatabaseTest, RigsThatCannotBeStoredChangeNothing) {
  Write(DatabaseSchema::k312);
  DatabaseContents contents = ContentsWithRig();
  contents.rigs.push_back({RigId(8), std::nullopt, {}});
  {
    FeatureDatabase database(Path(), FeatureDatabase::OpenMode::kExisting);
    EXPECT_THAT(ErrorOf([&] {
                  database.WriteRigsAndFrames(contents.rigs, contents.frames);
                }),
                AllOf(HasSubstr(Path()), HasSubstr("rig 8"),
                      HasSubstr("not a camera")));
  }
  const DatabaseContents read = Read();
  ASSERT_EQ(read.rigs.size(), 1u);
  EXPECT_EQ(read.rigs[0].sensors.size(), 2u);
  EXPECT_EQ(read.frames.size(), 2u);
}

TEST_F(FeatureDatabaseTest, AnUndoneTransactionLeavesNoColumnBehind) {
  Write();
  FeatureDatabase database(Path(), FeatureDatabase::OpenMode::kExisting);
  PosePriorRow prior;
  prior.image_id = ImageId(1);
  prior.gravity = Eigen::Vector3d::UnitY();
  {
    // The first direction of gravity adds its column.
    DatabaseTransaction transaction(&database);
    database.WritePosePrior(prior);
  }
  EXPECT_TRUE(database.ReadPosePriors().empty());
  database.WritePosePrior(prior);
  ASSERT_EQ(database.ReadPosePriors().size(), 1u);
  EXPECT_EQ(database.ReadPosePriors()[0].gravity, prior.gravity);
}

TEST_F(FeatureDatabaseTest, WritingWhileItIsReadIsNoticed) {
  Write();
  FeatureDatabase database(Path(), FeatureDatabase::OpenMode::kReadOnly);
  database.CheckUnchanged();
  Execute("UPDATE images SET name = 'new.png' WHERE image_id = 1");
  EXPECT_THAT(ErrorOf([&] { database.CheckUnchanged(); }),
              AllOf(HasSubstr(Path()), HasSubstr("another program"),
                    HasSubstr("try again")));
}

// pose_priors of COLMAP 4: rows have ids of their own, and name the data of a
// sensor.
class Colmap4Priors : public FeatureDatabaseTest {
 protected:
  void WriteVersion4() const {
    Write(DatabaseSchema::k312);
    Execute(
        "DROP TABLE pose_priors; CREATE TABLE pose_priors (pose_prior_id "
        "INTEGER PRIMARY KEY NOT NULL, corr_data_id INTEGER NOT NULL, "
        "corr_sensor_id INTEGER NOT NULL, corr_sensor_type INTEGER NOT NULL, "
        "position BLOB, position_covariance BLOB, gravity BLOB, "
        "coordinate_system INTEGER NOT NULL); PRAGMA user_version = 4020000");
  }
  static PosePriorRow Prior(uint32_t image_id, double x) {
    return {ImageId(image_id), PosePriorRow::CoordinateSystem::kCartesian,
            Eigen::Vector3d(x, 2.0, 3.0), Eigen::Matrix3d::Identity(),
            Eigen::Vector3d(0.0, 1.0, x)};
  }
  int64_t Number(const std::string& sql) const {
    const SqliteDatabase database =
        SqliteDatabase::OpenReadWrite(Path(), Path());
    SqliteStatement row = database.Prepare(sql);
    EXPECT_TRUE(row.Step()) << sql;
    return row.Int(0);
  }
};

TEST_F(Colmap4Priors, AreReadAsTheyWereWritten) {
  WriteVersion4();
  {
    FeatureDatabase database(Path(), FeatureDatabase::OpenMode::kExisting);
    for (const uint32_t image_id : {4u, 1u}) {
      database.WritePosePrior(Prior(image_id, 10.0 * image_id));
    }
  }
  // This prior is that of an IMU whose data have the number of an image.
  Execute(
      "INSERT INTO pose_priors (corr_data_id, corr_sensor_id, "
      "corr_sensor_type, position, coordinate_system) VALUES (2, 1, 1, "
      "zeroblob(24), 1)");
  const std::vector<PosePriorRow> read =
      FeatureDatabase(Path(), FeatureDatabase::OpenMode::kReadOnly)
          .ReadPosePriors();
  ASSERT_EQ(read.size(), 2u);
  for (size_t i = 0; i < 2; ++i) {
    const uint32_t image_id = i == 0 ? 1 : 4;
    const PosePriorRow expected = Prior(image_id, 10.0 * image_id);
    EXPECT_EQ(read[i].image_id, expected.image_id);
    EXPECT_EQ(read[i].coordinate_system, expected.coordinate_system);
    EXPECT_EQ(read[i].position, expected.position);
    EXPECT_EQ(read[i].covariance, expected.covariance);
    EXPECT_EQ(read[i].gravity, expected.gravity);
  }
  // Images 1 and 4 are of the cameras 1 and 2.
  const std::string sensor =
      "SELECT corr_sensor_id FROM pose_priors WHERE corr_data_id = ";
  EXPECT_EQ(Number(sensor + "1"), 1);
  EXPECT_EQ(Number(sensor + "4"), 2);
}

// The id of a prior is not that of its image.
TEST_F(Colmap4Priors, ReplaceThatOfTheSameImageOnly) {
  WriteVersion4();
  Execute(
      "INSERT INTO pose_priors VALUES (2, 1, 1, 0, zeroblob(24), NULL, NULL, "
      "1), (7, 2, 1, 0, zeroblob(24), NULL, NULL, 1)");
  {
    FeatureDatabase database(Path(), FeatureDatabase::OpenMode::kExisting);
    database.WritePosePrior(Prior(2, 5.0));
  }
  const std::vector<PosePriorRow> read =
      FeatureDatabase(Path(), FeatureDatabase::OpenMode::kReadOnly)
          .ReadPosePriors();
  ASSERT_EQ(read.size(), 2u);
  EXPECT_EQ(read[0].image_id, ImageId(1));
  EXPECT_EQ(read[0].position, Eigen::Vector3d(0.0, 0.0, 0.0));
  EXPECT_EQ(read[1].image_id, ImageId(2));
  EXPECT_EQ(read[1].position, Prior(2, 5.0).position);
}

TEST_F(Colmap4Priors, BelongToAnImage) {
  WriteVersion4();
  FeatureDatabase database(Path(), FeatureDatabase::OpenMode::kExisting);
  EXPECT_THROW(database.WritePosePrior(Prior(9, 1.0)), ContractError);
  EXPECT_TRUE(database.ReadPosePriors().empty());
}

}  // namespace
}  // namespace mgsfm

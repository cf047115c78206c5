// SPDX-License-Identifier: BSD-3-Clause
#include "mgsfm/database/database.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cstdlib>
#include <filesystem>
#include <optional>

#include "io/database_fixture.h"
#include "mgsfm/database/feature_database.h"
#include "support/threads.h"

namespace mgsfm {
namespace {

namespace fs = std::filesystem;
using testing::AllOf;
using testing::HasSubstr;

// Sets the folder for temporary files.
class TemporaryFolderAt {
 public:
  explicit TemporaryFolderAt(const std::string& path) {
    if (const char* before = std::getenv("TMPDIR")) before_ = before;
    setenv("TMPDIR", path.c_str(), 1);
  }
  ~TemporaryFolderAt() {
    if (before_) {
      setenv("TMPDIR", before_->c_str(), 1);
    } else {
      unsetenv("TMPDIR");
    }
  }
  TemporaryFolderAt(const TemporaryFolderAt&) = delete;
  TemporaryFolderAt& operator=(const TemporaryFolderAt&) = delete;

 private:
  std::optional<std::string> before_;
};

TEST_F(DatabaseTest, ReadsWhatWasWritten) {
  for (const DatabaseSchema schema :
       {DatabaseSchema::k38, DatabaseSchema::k312}) {
    const DatabaseContents written = ContentsWithRig();
    const std::string path = Path(std::to_string(static_cast<int>(schema)));
    WriteDatabase(path, written, schema);
    const DatabaseContents read = ReadDatabase(path, Context());
    ExpectSameImages(read, written);
    ExpectSamePairs(read, written);
    EXPECT_EQ(read.rigs.empty(), schema == DatabaseSchema::k38);
    EXPECT_EQ(read.path, path);
  }
}

TEST_F(DatabaseTest, OutliersAreTheMatchesOfOtherKeypoints) {
  DatabaseContents written = ContentsWithRig();
  for (TwoViewGeometryRow& pair : written.pairs) {
    pair.matches = {{0, 1}, {4, 3}};
    pair.outliers = {{7, 6}, {2, 0}, {0, 9}, {8, 3}};
  }
  WriteDatabase(Path(), written, DatabaseSchema::k312);
  for (TwoViewGeometryRow& pair : written.pairs) {
    pair.outliers = {{7, 6}, {2, 0}};
  }
  ExpectSamePairs(Read(), written);
  // Raw matches of a pair without geometry, verified pairs without raw matches,
  // and pairs that do not verify.
  Execute(
      "INSERT INTO matches SELECT MIN(pair_id) - 1, rows, cols, data FROM "
      "matches;"
      "DELETE FROM matches WHERE pair_id = (SELECT MIN(pair_id) FROM "
      "two_view_geometries);"
      "UPDATE two_view_geometries SET rows = 0, data = NULL WHERE pair_id = "
      "(SELECT MAX(pair_id) FROM matches)");
  written.pairs.front().outliers.clear();
  written.pairs.back().outliers.clear();
  written.pairs.back().matches.clear();
  ExpectSamePairs(Read(), written);
  Execute("DROP TABLE matches");
  for (const TwoViewGeometryRow& pair : Read().pairs) {
    EXPECT_TRUE(pair.outliers.empty());
  }
}

TEST_F(DatabaseTest, ThreadsDoNotMatter) {
  Write();
  const DatabaseContents one = Read();
  const DatabaseContents three = ReadDatabase(Path(), Threads(3));
  ExpectSameImages(three, one);
  ExpectSamePairs(three, one);
}

TEST_F(DatabaseTest, ReadsRigsAndFrames) {
  Write(DatabaseSchema::k312);
  DatabaseContents read = Read();
  ASSERT_EQ(read.rigs.size(), 1u);
  EXPECT_EQ(read.rigs[0].id, RigId(4));
  EXPECT_EQ(read.rigs[0].ref_camera_id, CameraId(1));
  ASSERT_EQ(read.rigs[0].sensors.size(), 2u);
  EXPECT_EQ(read.rigs[0].sensors[1].camera_id, CameraId(2));
  ExpectSamePose(read.rigs[0].sensors[1].sensor_from_rig.value(),
                 *ContentsWithRig().rigs[0].sensors[1].sensor_from_rig);
  ASSERT_EQ(read.frames.size(), 2u);
  EXPECT_EQ(read.frames[1].id, FrameId(5));
  ASSERT_EQ(read.frames[1].data.size(), 2u);
  EXPECT_EQ(read.frames[1].data[1].image_id, ImageId(4));
  EXPECT_EQ(read.frames[1].data[1].camera_id, CameraId(2));

  Execute("UPDATE rig_sensors SET sensor_from_rig = NULL");
  Execute("INSERT INTO rig_sensors VALUES (4, 9, 1, NULL)");  // an IMU
  read = Read();
  ASSERT_EQ(read.rigs[0].sensors.size(), 2u);
  EXPECT_FALSE(read.rigs[0].sensors[1].sensor_from_rig.has_value());
}

TEST_F(DatabaseTest, ReadsTheNewestColumns) {
  Write(DatabaseSchema::k312);
  const DatabaseContents before = Read();
  Execute(
      "DROP TABLE pose_priors; CREATE TABLE pose_priors (pose_prior_id INTEGER "
      "PRIMARY KEY NOT NULL, corr_data_id INTEGER NOT NULL);"
      "ALTER TABLE descriptors ADD COLUMN type INTEGER NOT NULL DEFAULT 0;"
      "ALTER TABLE two_view_geometries ADD COLUMN camera1 BLOB;"
      "ALTER TABLE two_view_geometries ADD COLUMN camera2 BLOB;"
      "PRAGMA user_version = 4020000");
  const DatabaseContents after = Read();
  ExpectSameImages(after, before);
  ExpectSamePairs(after, before);
}

TEST_F(DatabaseTest, ReadsTheAncientTableOfMatches) {
  Write();
  const DatabaseContents before = Read();
  Execute(
      "ALTER TABLE two_view_geometries RENAME TO inlier_matches;"
      "ALTER TABLE inlier_matches DROP COLUMN qvec;"
      "ALTER TABLE inlier_matches DROP COLUMN tvec;"
      "ALTER TABLE inlier_matches DROP COLUMN F");
  const DatabaseContents after = Read();
  ASSERT_EQ(after.pairs.size(), before.pairs.size());
  EXPECT_EQ(after.pairs[0].matches.size(), before.pairs[0].matches.size());
  EXPECT_EQ(after.pairs[0].E, before.pairs[0].E);
  EXPECT_FALSE(after.pairs[0].F.has_value());
  EXPECT_FALSE(after.pairs[0].cam2_from_cam1.has_value());
}

TEST_F(DatabaseTest, ReadsPositionsOfAllKeypointLayouts) {
  for (const int cols : {2, 4, 6}) {
    const std::string path = Path(std::to_string(cols));
    WriteDatabase(path, MakeContents(kNames), DatabaseSchema::k38);
    std::vector<float> values(20 * cols);
    for (size_t i = 0; i < values.size(); ++i) values[i] = 0.5f * i;
    SqliteDatabase database = SqliteDatabase::OpenReadWrite(path, path);
    SqliteStatement row = database.Prepare(
        "UPDATE keypoints SET cols = ?1, data = ?2 WHERE image_id = 3");
    row.Bind(cols, BlobOf(values));
    row.Run();
    const DatabaseContents read = ReadDatabase(path, Context());
    for (int i = 0; i < 20; ++i) {
      EXPECT_EQ(read.images[2].keypoints_px[i].x(), 0.5f * (i * cols));
      EXPECT_EQ(read.images[2].keypoints_px[i].y(), 0.5f * (i * cols + 1));
    }
  }
}

TEST_F(DatabaseTest, AbsentGeometryIsNotSet) {
  // Versions mark unset values by NULL, empty, zero, identity or a zero
  // quaternion.
  for (const std::string assignments :
       {"F = NULL, E = NULL, H = NULL, qvec = NULL, tvec = NULL",
        "F = x'', E = x'', H = x'', qvec = x'', tvec = x''",
        "F = zeroblob(72), E = zeroblob(72), H = zeroblob(72), "
        "qvec = zeroblob(32), tvec = zeroblob(24)",
        "F = zeroblob(72), E = zeroblob(72), H = zeroblob(72), tvec = "
        "zeroblob(24), qvec = x'000000000000f03f' || zeroblob(24)"}) {
    fs::remove(Path());
    Write();
    Execute("UPDATE two_view_geometries SET " + assignments);
    if (assignments.find("||") != std::string::npos) {
      // Concatenation makes a text of the blobs.
      Execute("UPDATE two_view_geometries SET qvec = CAST(qvec AS BLOB)");
    }
    for (const TwoViewGeometryRow& pair : Read().pairs) {
      EXPECT_FALSE(pair.F || pair.E || pair.H || pair.cam2_from_cam1);
      EXPECT_EQ(pair.matches.size(), 12u);
    }
  }
}

TEST_F(DatabaseTest, ImagesMayHaveNoFeaturesAndPairsNoMatches) {
  Write();
  Execute(
      "UPDATE keypoints SET rows = 0, data = NULL WHERE image_id = 1;"
      "DELETE FROM keypoints WHERE image_id = 2;"
      "UPDATE two_view_geometries SET rows = 0, data = NULL, config = 0");
  const DatabaseContents read = Read();
  EXPECT_TRUE(read.images[0].keypoints_px.empty());
  EXPECT_TRUE(read.images[1].keypoints_px.empty());
  EXPECT_EQ(read.images[2].keypoints_px.size(), 20u);
  for (const TwoViewGeometryRow& pair : read.pairs) {
    EXPECT_TRUE(pair.matches.empty());
  }
}

struct Damage {
  std::string sql;
  std::vector<std::string> expected;  // in the message
};

void PrintTo(const Damage& damage, std::ostream* os) { *os << damage.sql; }

class DamagedDatabaseTest : public DatabaseTest,
                            public testing::WithParamInterface<Damage> {};

TEST_P(DamagedDatabaseTest, IsNamed) {
  Write(DatabaseSchema::k312);
  Execute(GetParam().sql);
  const std::string error = ReadError();
  EXPECT_THAT(error, HasSubstr(Path()));
  for (const std::string& expected : GetParam().expected) {
    EXPECT_THAT(error, HasSubstr(expected));
  }
  EXPECT_EQ(error.find('\n'), std::string::npos);
}

INSTANTIATE_TEST_SUITE_P(
    All, DamagedDatabaseTest,
    testing::Values(
        Damage{"DELETE FROM images", {"no images"}},
        Damage{"DROP TABLE keypoints", {"no table 'keypoints'"}},
        Damage{"DROP TABLE two_view_geometries", {"two_view_geometries"}},
        Damage{"DROP TABLE frame_data", {"frame_data"}},
        Damage{"ALTER TABLE keypoints DROP COLUMN cols", {"cols"}},
        Damage{"UPDATE cameras SET model = 99 WHERE camera_id = 2",
               {"camera 2", "99"}},
        Damage{"UPDATE cameras SET params = zeroblob(24)",
               {"camera 1", "24 bytes", "SIMPLE_RADIAL"}},
        Damage{"UPDATE cameras SET params = "
               "CAST(zeroblob(24) || x'000000000000f07f' AS BLOB)",
               {"camera 1", "not finite"}},
        Damage{"UPDATE cameras SET width = 0", {"camera 1", "0 x 480"}},
        Damage{"UPDATE images SET camera_id = 77 WHERE image_id = 2",
               {"cam0/1.png", "77"}},
        Damage{"UPDATE images SET name = '' WHERE image_id = 2",
               {"image 2", "no name"}},
        Damage{"UPDATE keypoints SET data = zeroblob(7) WHERE image_id = 3",
               {"cam1/0.png", "7 bytes", "20 x 2"}},
        Damage{"UPDATE keypoints SET cols = 3 WHERE image_id = 3",
               {"cam1/0.png", "20 x 3"}},
        Damage{"UPDATE keypoints SET rows = -1 WHERE image_id = 3",
               {"cam1/0.png"}},
        Damage{"UPDATE keypoints SET rows = 1, "
               "data = x'0000803f0000c07f' WHERE image_id = 3",
               {"cam1/0.png", "not finite"}},
        Damage{"UPDATE two_view_geometries SET data = zeroblob(9)",
               {"1 'cam0/0.png'", "2 'cam0/1.png'", "9 bytes"}},
        Damage{"UPDATE two_view_geometries SET cols = 4", {"12 x 4"}},
        Damage{"UPDATE two_view_geometries SET rows = 1, "
               "data = x'0000000014000000' WHERE pair_id = 2147483647*3 + 4",
               {"3 'cam1/0.png'", "4 'cam1/1.png'", "does not exist"}},
        Damage{"UPDATE matches SET rows = 1, "
               "data = x'1400000014000000' WHERE pair_id = 2147483647*3 + 4",
               {"3 'cam1/0.png'", "4 'cam1/1.png'", "does not exist"}},
        Damage{"UPDATE matches SET data = zeroblob(9)",
               {"1 'cam0/0.png'", "2 'cam0/1.png'", "9 bytes"}},
        Damage{"UPDATE two_view_geometries SET E = zeroblob(64)",
               {"E of", "64 bytes"}},
        Damage{"UPDATE two_view_geometries SET qvec = NULL",
               {"relative pose", "cam0/0.png"}},
        Damage{"UPDATE two_view_geometries SET config = 10",
               {"configuration 10", "cam0/0.png"}},
        Damage{"UPDATE two_view_geometries SET pair_id = 2147483647*3 + 9 "
               "WHERE pair_id = 2147483647*3 + 4",
               {"3 'cam1/0.png' and 9", "does not exist"}},
        Damage{"UPDATE two_view_geometries SET pair_id = 2147483647*4 + 3 "
               "WHERE pair_id = 2147483647*3 + 4",
               {"invalid pair id"}},
        Damage{"UPDATE rig_sensors SET sensor_from_rig = zeroblob(8)",
               {"camera 2 of rig 4", "8 bytes"}},
        Damage{"UPDATE rig_sensors SET rig_id = 8", {"camera 2 of rig 8"}},
        Damage{"UPDATE rig_sensors SET sensor_from_rig = "
               "CAST(x'000000000000f03f' || zeroblob(40) || "
               "x'9c7500883ce4377e' AS BLOB)",
               {"camera 2 of rig 4", "configure"}},
        Damage{"UPDATE frames SET rig_id = -1 WHERE frame_id = 3",
               {"frame 3", "id -1", "out of range"}},
        Damage{"UPDATE frame_data SET data_id = 44 WHERE data_id = 4",
               {"frame 5", "44"}},
        Damage{"UPDATE frame_data SET frame_id = 6 WHERE frame_id = 5",
               {"frame 6"}}));

TEST_F(DatabaseTest, FilesThatAreNoDatabase) {
  EXPECT_THAT(ReadError(), HasSubstr("no such file"));
  WriteTextFile(Path(), "");
  EXPECT_THAT(ReadError(), HasSubstr("not an SQLite database"));
  WriteTextFile(Path(), "These are more than sixteen bytes of text.");
  EXPECT_THAT(ReadError(), HasSubstr("not an SQLite database"));
  fs::remove(Path());
  Write();
  fs::resize_file(Path(), fs::file_size(Path()) / 2);
  EXPECT_THAT(ReadError(), HasSubstr(Path()));
  fs::remove(Path());
  fs::create_directory(Path());
  EXPECT_THAT(ReadError(), HasSubstr("not a file"));
}

TEST_F(DatabaseTest, ReadingChangesNothing) {
  fs::create_directory(dir_.path() / "data");
  const std::string path = Path("data/a b?c%20#.db");
  WriteDatabase(path, ContentsWithRig(), DatabaseSchema::k312);
  // COLMAP leaves its databases in this mode.
  SqliteDatabase::OpenReadWrite(path, path).Execute("PRAGMA journal_mode=WAL");
  fs::permissions(path, fs::perms::owner_read);
  fs::permissions(dir_.path() / "data",
                  fs::perms::owner_read | fs::perms::owner_exec);
  const auto before = FilesIn(dir_.path());
  const auto time = fs::last_write_time(dir_.path() / "data");
  ASSERT_EQ(before.size(), 1u);
  EXPECT_EQ(ReadDatabase(path, Context()).images.size(), 4u);
  EXPECT_EQ(FilesIn(dir_.path()), before);
  EXPECT_EQ(fs::last_write_time(dir_.path() / "data"), time);
  fs::permissions(dir_.path() / "data", fs::perms::owner_all);
}

TEST_F(DatabaseTest, ReadsTheWriteAheadLogWithoutTouchingIt) {
  Write();
  SqliteDatabase writer = SqliteDatabase::OpenReadWrite(Path(), Path());
  writer.Execute("PRAGMA journal_mode = WAL");
  writer.Execute("UPDATE images SET name = 'cam0/new.png' WHERE image_id = 2");
  // The database is open in another program, or was left so by a crash.
  fs::create_directory(dir_.path() / "left");
  for (const std::string suffix : {"", "-wal"}) {
    fs::copy_file(Path() + suffix, Path("left/database.db" + suffix));
  }
  fs::permissions(Path("left/database.db"), fs::perms::owner_read);
  for (const std::string& path : {Path(), Path("left/database.db")}) {
    const auto before = FilesIn(dir_.path());
    EXPECT_EQ(ReadDatabase(path, Context()).images[1].name, "cam0/new.png");
    EXPECT_EQ(FilesIn(dir_.path()), before);
  }
}

TEST_F(DatabaseTest, UndoesAnInterruptedTransactionInACopy) {
  Write();
  SqliteDatabase writer = SqliteDatabase::OpenReadWrite(Path(), Path());
  writer.Execute(
      "PRAGMA cache_size = 1; BEGIN; UPDATE images SET name = name || 'x';"
      "UPDATE keypoints SET data = zeroblob(100000);"
      "UPDATE two_view_geometries SET data = zeroblob(100000)");
  fs::create_directory(dir_.path() / "left");
  for (const std::string suffix : {"", "-journal"}) {
    fs::copy_file(Path() + suffix, Path("left/database.db" + suffix));
  }
  ASSERT_NE(ReadTextFile(Path("left/database.db")).find("1.pngx"),
            std::string::npos);
  const auto before = FilesIn(dir_.path());
  const DatabaseContents read =
      ReadDatabase(Path("left/database.db"), Context());
  ExpectSameImages(read, MakeContents(kNames));
  EXPECT_EQ(FilesIn(dir_.path()), before);
}

TEST_F(DatabaseTest, FollowsLinksToTheLog) {
  Write();
  SqliteDatabase writer = SqliteDatabase::OpenReadWrite(Path(), Path());
  writer.Execute("PRAGMA journal_mode = WAL");
  writer.Execute("UPDATE images SET name = 'cam0/new.png' WHERE image_id = 2");
  fs::create_symlink(Path(), Path("link.db"));
  EXPECT_EQ(ReadDatabase(Path("link.db"), Context()).images[1].name,
            "cam0/new.png");
}

// Views and computed columns can take any time and memory.
TEST_F(DatabaseTest, TablesMustStoreTheirRows) {
  const auto refuses = [&](const std::string& sql) {
    Write();
    Execute(sql);
    EXPECT_THAT(ReadError(), HasSubstr("computes the rows")) << sql;
    EXPECT_THAT(ErrorOf([&] {
                  FeatureDatabase(Path(), FeatureDatabase::OpenMode::kExisting);
                }),
                HasSubstr("computes the rows"))
        << sql;
    fs::remove(Path());
  };
  const std::string view =
      " AS WITH RECURSIVE n(i) AS (SELECT 1 UNION ALL SELECT i + 1 FROM n) "
      "SELECT i AS image_id, 'a' || i AS name, 1 AS camera_id FROM n";
  refuses("PRAGMA foreign_keys = OFF; DROP TABLE images; CREATE VIEW images" +
          view);
  refuses("PRAGMA foreign_keys = OFF; DROP TABLE images; CREATE VIEW Images" +
          view);
  refuses(
      "DROP TABLE keypoints; CREATE TABLE keypoints (image_id INTEGER PRIMARY "
      "KEY, rows, cols, data AS (zeroblob(900000000)))");
  refuses(
      "DROP TABLE keypoints; CREATE VIRTUAL TABLE keypoints USING "
      "fts5(image_id, rows, cols, data)");
}

// In a damaged file, pages may contain themselves.
TEST_F(DatabaseTest, WorkIsLimitedByTheSizeOfTheFile) {
  SqliteDatabase database = SqliteDatabase::Create(Path());
  database.Execute("CREATE TABLE t (a INTEGER PRIMARY KEY, b INT)");
  database.Execute(
      "WITH RECURSIVE n(i) AS (SELECT 1 UNION ALL SELECT i + 1 FROM n WHERE i "
      "< 400) INSERT INTO t SELECT i, i FROM n");
  database.LimitWork(1000);
  SqliteStatement rows = database.Prepare(
      "SELECT x.b FROM t AS x, t AS y, t AS z WHERE x.b + y.b + z.b < 0");
  EXPECT_THAT(ErrorOf([&] { rows.Step(); }), HasSubstr("is damaged"));
  SqliteStatement small = database.Prepare("SELECT b FROM t");
  EXPECT_TRUE(small.Step());
}

TEST_F(DatabaseTest, NamesMustBeUsable) {
  for (const auto& [name, problem] :
       {std::pair("CAST(x'61ff' AS TEXT)", "is not valid UTF-8"),
        std::pair("CAST(x'6100' AS TEXT)", "has a control character"),
        std::pair("'a' || char(10)", "has a control character"),
        std::pair("hex(zeroblob(3000))", "is longer than 4096 bytes")}) {
    Write();
    Execute(std::string("UPDATE images SET name = ") + name +
            " WHERE image_id = 2");
    EXPECT_THAT(ReadError(), AllOf(HasSubstr("image 2"), HasSubstr(problem)));
    fs::remove(Path());
  }
}

TEST_F(DatabaseTest, NamesOfDatabasesInMemoryAreRefused) {
  for (const char* path : {":memory:", ":any:"}) {
    EXPECT_THAT(ErrorOf([&] {
                  FeatureDatabase(path, FeatureDatabase::OpenMode::kOrCreate);
                }),
                HasSubstr("choose another name"));
    EXPECT_FALSE(fs::exists(path));
  }
}

TEST_F(DatabaseTest, SelectionsHaveTheirImagesAndPairsOnly) {
  Write(DatabaseSchema::k312);
  DatabaseSelection selection;
  selection.image_names = {"cam0/0.png", "cam0/1.png", "cam1/1.png", "none"};
  selection.has_pair = [](const std::string& a, const std::string& b) {
    return a == "cam0/0.png" || b == "cam0/0.png";
  };
  const DatabaseContents whole = Read();
  const DatabaseContents part = ReadDatabase(Path(), Context(), selection);
  EXPECT_TRUE(part.is_selection);
  ASSERT_EQ(part.images.size(), 3u);
  EXPECT_EQ(part.images[2].name, "cam1/1.png");
  EXPECT_EQ(part.images[2].keypoints_px, whole.images[3].keypoints_px);
  // Images are matched with the next two.
  ASSERT_EQ(part.pairs.size(), 1u);
  EXPECT_EQ(part.pairs[0].F, whole.pairs[0].F);
  ASSERT_EQ(part.frames.size(), 2u);
  EXPECT_EQ(part.frames[0].data.size(), 1u);
  EXPECT_EQ(part.frames[1].data.size(), 2u);
  selection.image_names = {"cam1/1.png"};
  EXPECT_EQ(ReadDatabase(Path(), Context(), selection).frames.size(), 1u);
}

TEST_F(DatabaseTest, MatchesAreReadWithoutGeometries) {
  Write();
  DatabaseSelection selection;
  selection.has_geometries = false;
  const DatabaseContents whole = Read();
  const DatabaseContents part = ReadDatabase(Path(), Context(), selection);
  EXPECT_TRUE(part.pairs.empty());
  ASSERT_EQ(part.matches.size(), whole.pairs.size());
  for (size_t i = 0; i < part.matches.size(); ++i) {
    EXPECT_EQ(part.matches[i].image_id1, whole.pairs[i].image_id1);
    EXPECT_EQ(part.matches[i].image_id2, whole.pairs[i].image_id2);
    EXPECT_EQ(part.matches[i].matches.size(), whole.pairs[i].matches.size());
  }
}

TEST_F(DatabaseTest, NamesAreThoseOfTheImages) {
  Write();
  EXPECT_EQ(ReadImageNames(Path()), kNames);
  SqliteDatabase::Create(Path("other.db")).Execute("CREATE TABLE notes (text)");
  EXPECT_THAT(ErrorOf([&] { (void)ReadImageNames(Path("other.db")); }),
              AllOf(HasSubstr(Path("other.db")), HasSubstr("check the path")));
}

// Databases with a log are read from a copy, which needs a folder.
TEST_F(DatabaseTest, AFolderForTheCopyIsNeeded) {
  Write();
  SqliteDatabase writer = SqliteDatabase::OpenReadWrite(Path(), Path());
  writer.Execute("PRAGMA journal_mode = WAL");
  writer.Execute("UPDATE images SET name = 'cam0/new.png' WHERE image_id = 2");
  for (const std::string& path : {Path("none"), Path()}) {
    const TemporaryFolderAt folder(path);
    EXPECT_THAT(ReadError(), HasSubstr("set TMPDIR to a folder")) << path;
  }
  EXPECT_EQ(Read().images[1].name, "cam0/new.png");
}

TEST_F(DatabaseTest, WritesNewFilesOnly) {
  Write();
  const auto before = FilesIn(dir_.path());
  EXPECT_THAT(ErrorOf([this] { Write(); }), HasSubstr("exists already"));
  EXPECT_EQ(FilesIn(dir_.path()), before);

  DatabaseContents twice = MakeContents(kNames);
  twice.images[1].name = twice.images[0].name;
  EXPECT_THROW(WriteDatabase(Path("new.db"), twice, DatabaseSchema::k38),
               Error);
  EXPECT_EQ(FilesIn(dir_.path()), before);
}

TEST(SwapImagesTest, KeepsWhatThePairSays) {
  Random random(1);
  const DatabaseContents contents = MakeContents(kNames);
  const TwoViewGeometryRow pair = contents.pairs[0];
  TwoViewGeometryRow swapped = pair;
  SwapImages(&swapped);
  EXPECT_EQ(swapped.image_id1, pair.image_id2);
  for (int i = 0; i < 10; ++i) {
    const Eigen::Vector3d x1 = RandomMatrix(&random).col(0);
    const Eigen::Vector3d x2 = RandomMatrix(&random).col(0);
    EXPECT_NEAR(x2.dot(*pair.F * x1), x1.dot(*swapped.F * x2), 1e-12);
    EXPECT_NEAR(x2.dot(*pair.E * x1), x1.dot(*swapped.E * x2), 1e-12);
    EXPECT_LT((*swapped.H * (*pair.H * x1) - x1).norm(), 1e-12);
    EXPECT_LT(
        (*swapped.cam2_from_cam1 * (*pair.cam2_from_cam1 * x1) - x1).norm(),
        1e-12);
  }
  for (size_t i = 0; i < pair.matches.size(); ++i) {
    EXPECT_EQ(swapped.matches[i].keypoint_idx1, pair.matches[i].keypoint_idx2);
    EXPECT_EQ(swapped.matches[i].keypoint_idx2, pair.matches[i].keypoint_idx1);
  }
}

}  // namespace
}  // namespace mgsfm

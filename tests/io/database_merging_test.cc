// SPDX-License-Identifier: BSD-3-Clause
#include "database/database_merging.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <filesystem>
#include <limits>
#include <map>
#include <set>

#include "database/database_shard.h"
#include "database/sqlite_database.h"
#include "io/merged_databases.h"
#include "mgsfm/base/error.h"
#include "mgsfm/database/feature_database.h"
#include "mgsfm/models/scene_loading.h"
#include "mgsfm/priors/pose_priors.h"
#include "support/database_rows.h"
#include "support/subprocess.h"

namespace mgsfm {
namespace {

namespace fs = std::filesystem;
using testing::AllOf;
using testing::HasSubstr;

std::set<std::string> FilesIn(const fs::path& folder) {
  std::set<std::string> names;
  for (const auto& entry : fs::directory_iterator(folder)) {
    names.insert(entry.path().filename().string());
  }
  return names;
}

// Rows of a database under the names of images.
const ImageRow& ImageOf(const DatabaseContents& contents,
                        const std::string& name) {
  for (const ImageRow& image : contents.images) {
    if (image.name == name) return image;
  }
  throw ContractError("no image " + name);
}
std::string NameOf(const DatabaseContents& contents, ImageId id) {
  for (const ImageRow& image : contents.images) {
    if (image.id == id) return image.name;
  }
  return "";
}

void ExpectContains(const DatabaseContents& merged, FeatureDatabase* features,
                    const DatabaseContents& part) {
  for (const ImageRow& image : part.images) {
    const ImageRow& copy = ImageOf(merged, image.name);
    EXPECT_EQ(copy.keypoints_px, image.keypoints_px);
    const DescriptorMatrix descriptors = features->ReadDescriptors(copy.id);
    ASSERT_EQ(descriptors.rows(),
              static_cast<Eigen::Index>(image.keypoints_px.size()));
    EXPECT_EQ(descriptors(0, 0), image.id.value());
  }
  for (const TwoViewGeometryRow& pair : part.pairs) {
    const auto copy = features->ReadTwoViewGeometry(
        ImageOf(merged, NameOf(part, pair.image_id1)).id,
        ImageOf(merged, NameOf(part, pair.image_id2)).id);
    ASSERT_TRUE(copy.has_value());
    // If the order of the ids changed, the row is that from 2 to 1.
    EXPECT_TRUE(copy->F->isApprox(*pair.F));
    EXPECT_TRUE(copy->E->isApprox(*pair.E));
    EXPECT_TRUE(copy->H->isApprox(*pair.H));
    EXPECT_EQ(copy->config, pair.config);
    EXPECT_TRUE(copy->cam2_from_cam1->translation.isApprox(
        pair.cam2_from_cam1->translation));
    EXPECT_EQ(copy->matches.size(), pair.matches.size());
    EXPECT_EQ(
        features
            ->ReadMatches(ImageOf(merged, NameOf(part, pair.image_id1)).id,
                          ImageOf(merged, NameOf(part, pair.image_id2)).id)
            .size(),
        pair.matches.size());
  }
}

TEST_F(DatabaseMerging, KeepsEverythingOfBoth) {
  const DatabaseContents a = MakeDatabase("a.db", "seq1");
  const DatabaseContents b = MakeDatabase("b.db", "seq2");
  const std::string before = ReadTextFile(Path("a.db"));
  Merge("merged.db");
  EXPECT_TRUE(ReadTextFile(Path("a.db")) == before);
  const DatabaseContents merged = ReadDatabase(Path("merged.db"), Context());
  FeatureDatabase features = Open("merged.db");
  EXPECT_EQ(merged.images.size(), 8u);
  EXPECT_EQ(merged.cameras.size(), a.cameras.size() + b.cameras.size());
  EXPECT_EQ(merged.pairs.size(), a.pairs.size() + b.pairs.size());
  ExpectContains(merged, &features, a);
  ExpectContains(merged, &features, b);
  ASSERT_EQ(merged.rigs.size(), 2u);
  for (const RigRow& rig : merged.rigs) {
    ASSERT_EQ(rig.sensors.size(), 2u);
    for (const RigSensorRow& sensor : rig.sensors) {
      const bool is_reference = sensor.camera_id == *rig.ref_camera_id;
      EXPECT_EQ(
          sensor.sensor_from_rig->translation,
          is_reference ? Eigen::Vector3d(0, 0, 0) : Eigen::Vector3d(1, 2, 3));
    }
  }
  ASSERT_EQ(merged.frames.size(), 4u);
  for (const FrameRow& frame : merged.frames) {
    ASSERT_EQ(frame.data.size(), 2u);
    const std::string first = NameOf(merged, frame.data[0].image_id);
    const std::string second = NameOf(merged, frame.data[1].image_id);
    EXPECT_EQ(first.substr(0, 4), second.substr(0, 4));
    EXPECT_EQ(first.substr(9), second.substr(9));
  }
  const std::vector<PosePriorRow> priors = features.ReadPosePriors();
  ASSERT_EQ(priors.size(), 8u);
  for (const PosePriorRow& prior : priors) {
    const std::string name = NameOf(merged, prior.image_id);
    const DatabaseContents& part = name.substr(0, 4) == "seq1" ? a : b;
    EXPECT_EQ(prior.position.z(), ImageOf(part, name).id.value());
    EXPECT_EQ(prior.coordinate_system, PosePriorRow::CoordinateSystem::kWgs84);
    EXPECT_EQ(prior.gravity, GravityOf(ImageOf(part, name).id));
  }
}

TEST_F(DatabaseMerging, KeepsGravityWithoutPositions) {
  MakeDatabase("a.db", "seq1");
  const DatabaseContents b = MakeDatabase("b.db", "seq2");
  const Eigen::Vector3d gravity(0.0, 3.0, 4.0);
  const auto set_gravity = [&](const Eigen::Vector3d& direction) {
    FeatureDatabase database = Open("b.db");
    PosePriorRow prior;
    prior.image_id = b.images[1].id;
    prior.position.setConstant(std::numeric_limits<double>::quiet_NaN());
    prior.gravity = direction;
    database.WritePosePrior(prior);
  };
  set_gravity(gravity);
  Merge("merged.db");
  const LoadedScene loaded = LoadScene(Path("merged.db"), {}, Context());
  PosePriorOptions options;
  options.use_prior_gravity = true;
  const GravityPriors priors =
      ReadGravity(loaded.scene, Path("merged.db"), options);
  ASSERT_EQ(priors.images.size(), 8u);
  for (size_t i = 0; i < priors.images.size(); ++i) {
    if (loaded.scene.images[i].name == b.images[1].name) {
      EXPECT_TRUE(priors.images[i]->isApprox(gravity.normalized()));
    }
  }
  // Another direction for the same image.
  fs::copy_file(Path("b.db"), Path("a.db"),
                fs::copy_options::overwrite_existing);
  set_gravity(-gravity);
  fs::remove(Path("merged.db"));
  EXPECT_THROW(Merge("merged.db"), Error);
}

TEST_F(DatabaseMerging, EqualInputGivesEqualFiles) {
  MakeDatabase("a.db", "seq1");
  MakeDatabase("b.db", "seq2");
  Merge("first.db");
  Merge("second.db");
  EXPECT_TRUE(ReadTextFile(Path("first.db")) ==
              ReadTextFile(Path("second.db")));
}

TEST_F(DatabaseMerging, RefusedDatabasesLeaveNothingBehind) {
  MakeDatabase("a.db", "seq1");
  const auto expect_refused = [&](const std::string& message) {
    try {
      Merge("merged.db");
      ADD_FAILURE() << "merged, not: " << message;
    } catch (const Error& error) {
      EXPECT_THAT(error.what(), HasSubstr(message));
    }
  };
  MakeDatabase("b.db", "seq1");
  {
    FeatureDatabase database = Open("b.db");
    const ImageRow image = database.ReadStructure(Context()).images[0];
    auto keypoints = database.ReadKeypoints(image.id);
    keypoints[0].x_px += 1.0f;
    database.WriteKeypoints(image.id, keypoints);
  }
  expect_refused("keypoints of image 'seq1/cam0/1.jpg' differ");
  MakeDifferentRig();
  expect_refused("has another pose");
  WriteTextFile(Path("b.db"), "no database");
  expect_refused("b.db");
  fs::remove(Path("b.db"));
  expect_refused("b.db");
  EXPECT_EQ(FilesIn(dir_.path()), (std::set<std::string>{"a.db"}));
  WriteTextFile(Path("merged.db"), "mine");
  expect_refused("exists");
  EXPECT_EQ(ReadTextFile(Path("merged.db")), "mine");
}

// The same images with other rows: the message names the database, what differs
// and the remedy, and nothing is written.
TEST_F(DatabaseMerging, ContradictionsAreNamed) {
  const char* const kSeparated = "separate them by image_prefix";
  const char* const kShards = "match all shards with the same options";
  const struct {
    const char* sql;
    const char* problem;
    const char* remedy;
  } contradictions[] = {
      {"UPDATE descriptors SET data = zeroblob(length(data))",
       "the descriptors of image 'seq1/cam0/1.jpg' differ", kSeparated},
      {"UPDATE matches SET data = zeroblob(length(data))",
       "the list of matches of image 1 and image 2 differs", kShards},
      {"UPDATE two_view_geometries SET config = 3",
       "the two-view geometry of image 1 and image 2 differs", kShards},
      {"UPDATE two_view_geometries SET tvec = zeroblob(24)",
       "the two-view geometry of image 1 and image 2 differs", kShards},
      {"UPDATE two_view_geometries SET qvec = NULL, tvec = NULL",
       "the two-view geometry of image 1 and image 2 differs", kShards},
      {"UPDATE pose_priors SET coordinate_system = 1",
       "the pose priors of image 'seq1/cam0/1.jpg' differ", kSeparated},
      {"UPDATE pose_priors SET position_covariance = NULL",
       "the pose priors of image 'seq1/cam0/1.jpg' differ", kSeparated},
      {"UPDATE cameras SET width = 641",
       "has 641 x 480 pixels, parameters 500.000000",
       "extract all images with the same options"},
      {"UPDATE rig_sensors SET sensor_from_rig = NULL", "has another pose",
       "configure both databases with the same rig_config"},
      {"UPDATE frame_data SET frame_id = 13 - frame_id WHERE sensor_id = 2",
       "is in a frame of 2 images, but in another frame in",
       "configure the rigs of both in the same way"}};
  MakeDatabase("a.db", "seq1");
  for (const auto& [sql, problem, remedy] : contradictions) {
    fs::copy_file(Path("a.db"), Path("b.db"),
                  fs::copy_options::overwrite_existing);
    SqliteDatabase::OpenReadWrite(Path("b.db"), Path("b.db")).Execute(sql);
    EXPECT_THAT(
        ErrorOf([&] { Merge("merged.db"); }),
        AllOf(HasSubstr(Path("b.db")), HasSubstr(problem), HasSubstr(remedy)))
        << sql;
    EXPECT_EQ(FilesIn(dir_.path()), (std::set<std::string>{"a.db", "b.db"}))
        << sql;
  }
}

// Sessions of one vehicle whose cameras differ.
TEST_F(DatabaseMerging, VehiclesHaveOneCalibration) {
  MakeDatabase("a.db", "drive");
  MakeDatabase("b.db", "drive");
  SqliteDatabase::OpenReadWrite(Path("b.db"), Path("b.db"))
      .Execute("UPDATE cameras SET height = 481 WHERE camera_id = 2");
  EXPECT_THAT(
      ErrorOf([&] {
        MergeDatabases(
            {{Path("a.db"), "mon/", "van"}, {Path("b.db"), "tue/", "van"}},
            Path("merged.db"), Context());
      }),
      AllOf(HasSubstr("drive/cam1/2.jpg"), HasSubstr("640 x 481"),
            HasSubstr("640 x 480"),
            HasSubstr("give the vehicle one calibration, or two names")));
  EXPECT_FALSE(fs::exists(Path("merged.db")));
}

// COLMAP deletes images without their features and pairs.
TEST_F(DatabaseMerging, RowsOfDeletedImagesAreLeftOut) {
  const DatabaseContents a = MakeDatabase("a.db", "seq1");
  MakeDatabase("b.db", "seq2");
  SqliteDatabase::OpenReadWrite(Path("b.db"), Path("b.db"))
      .Execute(
          "PRAGMA foreign_keys = OFF; DELETE FROM images WHERE image_id = 4; "
          "DELETE FROM frame_data WHERE data_id = 4");
  Merge("merged.db");
  const DatabaseContents merged = ReadDatabase(Path("merged.db"), Context());
  FeatureDatabase features(Path("merged.db"),
                           FeatureDatabase::OpenMode::kReadOnly);
  EXPECT_EQ(merged.images.size(), 7u);
  EXPECT_EQ(features.ImagesWithKeypoints().size(), 7u);
  EXPECT_EQ(features.ImagesWithDescriptors().size(), 7u);
  EXPECT_EQ(features.ReadPosePriors().size(), 7u);
  // Both have the pairs 12, 13, 23, 24 and 34; those of the deleted image 4 are
  // left out of the second one.
  ASSERT_EQ(a.pairs.size(), 5u);
  EXPECT_EQ(merged.pairs.size(), 8u);
  EXPECT_EQ(features.CountMatches().size(), 8u);
  ExpectContains(merged, &features, a);
}

TEST_F(DatabaseMerging, PrefixesMakeUsableNames) {
  MakeDatabase("a.db", "seq1");
  EXPECT_THAT(ErrorOf([&] {
                MergeDatabases({{Path("a.db"), "van\n/"}}, Path("merged.db"),
                               Context());
              }),
              AllOf(HasSubstr("the prefix of images of '" + Path("a.db")),
                    HasSubstr("has a control character")));
  EXPECT_FALSE(fs::exists(Path("merged.db")));
}

TEST_F(DatabaseMerging, DatabasesWithoutImagesAreNoMap) {
  for (const char* name : {"a.db", "b.db"}) {
    FeatureDatabase empty(Path(name), FeatureDatabase::OpenMode::kOrCreate);
    DatabaseTransaction(&empty).Commit();
  }
  EXPECT_THAT(ErrorOf([&] { Merge("merged.db"); }),
              HasSubstr("no images to merge"));
  EXPECT_EQ(FilesIn(dir_.path()), (std::set<std::string>{"a.db", "b.db"}));
}

TEST_F(DatabaseMerging, NeitherOrderNorRepetitionMatters) {
  MakeDatabase("a.db", "seq1");
  MakeDatabase("b.db", "seq2");
  MakeDatabase("c.db", "seq0");
  const auto merge = [&](const std::vector<std::string>& names,
                         const std::string& merged) {
    std::vector<MergeInput> inputs;
    for (const std::string& name : names) inputs.push_back({Path(name)});
    MergeDatabases(inputs, Path(merged), Context());
  };
  merge({"a.db", "b.db", "c.db"}, "abc.db");
  merge({"c.db", "a.db", "b.db", "a.db"}, "caba.db");
  merge({"b.db", "a.db"}, "ba.db");
  fs::copy_file(Path("c.db"), Path("copy.db"));
  merge({"ba.db", "copy.db", "b.db", "c.db"}, "again.db");
  for (const char* other : {"caba.db", "again.db"}) {
    ExpectEqualRows(Path("abc.db"), Path(other));
  }
}

TEST_F(DatabaseMerging, VehiclesShareTheirRigAndSessionsTheirNames) {
  for (const char* name : {"a.db", "b.db", "c.db"}) MakeDatabase(name, "drive");
  MergeDatabases({{Path("a.db"), "mon/", "van"},
                  {Path("b.db"), "tue/", "van"},
                  {Path("c.db"), "truck/", "truck"}},
                 Path("merged.db"), Context());
  const DatabaseContents merged = ReadDatabase(Path("merged.db"), Context());
  ASSERT_EQ(merged.images.size(), 12u);
  ASSERT_EQ(merged.cameras.size(), 4u);
  ASSERT_EQ(merged.rigs.size(), 2u);
  ASSERT_EQ(merged.frames.size(), 6u);
  // The rig of each frame and the camera of each image are those of the
  // vehicle.
  std::map<std::string, std::set<RigId>> rigs;
  std::map<std::string, std::set<CameraId>> cameras;
  for (const FrameRow& frame : merged.frames) {
    for (const FrameDataRow& data : frame.data) {
      const std::string name = NameOf(merged, data.image_id);
      const std::string vehicle =
          name.substr(0, name.find('/')) == "truck" ? "truck" : "van";
      rigs[vehicle].insert(frame.rig_id);
      cameras[vehicle + name.substr(name.find("cam"), 4)].insert(
          data.camera_id);
    }
  }
  EXPECT_EQ(rigs.size(), 2u);
  for (const auto& [vehicle, ids] : rigs) EXPECT_EQ(ids.size(), 1u) << vehicle;
  EXPECT_EQ(cameras.size(), 4u);
  for (const auto& [camera, ids] : cameras) EXPECT_EQ(ids.size(), 1u) << camera;
  // Both sessions of a vehicle have the same calibration, or it is an error.
  MakeDifferentRig();
  EXPECT_THROW(MergeDatabases({{Path("a.db"), "mon/", "van"},
                               {Path("b.db"), "tue/", "van"}},
                              Path("other.db"), Context()),
               Error);
  MergeDatabases({{Path("a.db"), "mon/", "van"}, {Path("b.db"), "tue/", "bus"}},
                 Path("other.db"), Context());
}

TEST_F(DatabaseMerging, LostRigsAreNamed) {
  MakeDatabase("a.db", "a");
  MakeDatabase("b.db", "b");
  Open("b.db").WriteRigsAndFrames({}, {});
  std::vector<std::string> warnings;
  Context context;
  context.log = [&](LogLevel level, const std::string& text) {
    if (level == LogLevel::kWarning) warnings.push_back(text);
  };
  MergeDatabases({{Path("a.db")}, {Path("b.db")}}, Path("merged.db"), context);
  ASSERT_EQ(warnings.size(), 1u);
  EXPECT_THAT(warnings[0], AllOf(HasSubstr("b.db' has no rigs"),
                                 HasSubstr("4 of its images")));
  // Both databases give the images frames by their folders.
  Open("a.db").WriteRigsAndFrames({}, {});
  warnings.clear();
  MergeDatabases({{Path("a.db")}, {Path("b.db")}}, Path("both.db"), context);
  EXPECT_THAT(warnings, testing::IsEmpty());
}

// Rigs that a database holds, but that no rows define.
TEST_F(DatabaseMerging, DamagedRigsAreNamed) {
  const std::pair<const char*, const char*> damages[] = {
      {"UPDATE rigs SET ref_sensor_type = 1", "rig 3"},
      {"UPDATE rigs SET ref_sensor_id = 77", "rig 3"},
      {"UPDATE rig_sensors SET sensor_id = 77", "rig 3"},
      {"UPDATE frames SET rig_id = 5 WHERE frame_id = 9", "frame 9"},
      {"UPDATE frame_data SET sensor_id = 77 WHERE frame_id = 9", "frame 9"}};
  MakeDatabase("a.db", "seq1");
  for (const auto& [sql, name] : damages) {
    fs::remove(Path("b.db"));
    MakeDatabase("b.db", "seq2");
    SqliteDatabase::OpenReadWrite(Path("b.db"), Path("b.db")).Execute(sql);
    try {
      Merge("merged.db");
      ADD_FAILURE() << sql;
    } catch (const Error& error) {
      EXPECT_THAT(error.what(), AllOf(HasSubstr("b.db"), HasSubstr(name)));
    }
    EXPECT_FALSE(fs::exists(Path("merged.db")));
  }
}

// A shard with the matches of one pair of a.db, and what it must not be merged
// with.
class MatchShards : public DatabaseMerging {
 protected:
  MatchShards() {
    MakeDatabase("a.db", "seq1");
    WriteShard();
  }
  void WriteShard() const {
    std::string fingerprint;
    {
      const FeatureDatabase database(Path("a.db"),
                                     FeatureDatabase::OpenMode::kReadOnly);
      fingerprint = FingerprintOfStructure(database, Context());
    }
    fs::remove(Path("b.db"));
    FeatureDatabase shard(Path("b.db"), FeatureDatabase::OpenMode::kOrCreate);
    shard.WriteShard({ShardKind::kMatches,
                      {1, 1},
                      fingerprint + "options",
                      /*is_complete=*/true});
    shard.WriteMatches(ImageId(1), ImageId(4), {{3, 7}});
    shard.WriteTwoViewGeometry({ImageId(1),
                                ImageId(4),
                                TwoViewConfig::kCalibrated,
                                {},
                                Eigen::Matrix3d::Identity(),
                                {},
                                Rigid3{ExpSO3({0.1, 0.0, 0.0}), {1, 2, 3}},
                                {{3, 7}}});
  }
  void ExpectRefused(const std::vector<MergeInput>& inputs,
                     const std::string& problem,
                     const std::string& remedy) const {
    EXPECT_THAT(
        ErrorOf([&] { MergeDatabases(inputs, Path("merged.db"), Context()); }),
        AllOf(HasSubstr(problem), HasSubstr(remedy)));
    EXPECT_FALSE(fs::exists(Path("merged.db")));
  }
};

TEST_F(MatchShards, AddTheirPairs) {
  Merge("merged.db");
  const DatabaseContents before = ReadDatabase(Path("a.db"), Context());
  const DatabaseContents merged = ReadDatabase(Path("merged.db"), Context());
  ASSERT_EQ(merged.pairs.size(), before.pairs.size() + 1);
  const FeatureDatabase features(Path("merged.db"),
                                 FeatureDatabase::OpenMode::kReadOnly);
  ExpectSameMatches(features.ReadMatches(ImageId(1), ImageId(4)), {{3, 7}});
  const auto pair = features.ReadTwoViewGeometry(ImageId(1), ImageId(4));
  ASSERT_TRUE(pair.has_value());
  EXPECT_EQ(pair->E, Eigen::Matrix3d::Identity());
  EXPECT_EQ(pair->cam2_from_cam1->translation, Eigen::Vector3d(1, 2, 3));
  ExpectSameMatches(pair->matches, {{3, 7}});
}

TEST_F(MatchShards, AreOfOneDatabase) {
  MakeDatabase("c.db", "seq2");
  const MergeInput a{Path("a.db")}, b{Path("b.db")}, c{Path("c.db")};
  ExpectRefused({a, c, b}, "cannot be merged together with shards of matches",
                "merge the features first");
  ExpectRefused({{Path("a.db"), "van/"}, b}, "neither prefixes nor vehicles",
                "when the features are merged");
  ExpectRefused({c, b}, "was not matched from '" + Path("c.db"),
                "match it again");
  SqliteDatabase writer =
      SqliteDatabase::OpenReadWrite(Path("a.db"), Path("a.db"));
  writer.Execute("PRAGMA journal_mode = WAL");
  WriteShard();
  writer.Execute("DELETE FROM matches");
  ExpectRefused({a, b}, "has unfinished changes in '" + Path("a.db-wal"),
                "open it once with its program");
}

TEST_F(MatchShards, AreDamaged) {
  for (const char* sql :
       {"UPDATE mgsfm_shard SET kind = 'points'",
        "UPDATE mgsfm_shard SET number = 2",
        "UPDATE mgsfm_shard SET number = 0",
        "UPDATE mgsfm_shard SET number = 3000000000, count = 3000000000",
        "UPDATE mgsfm_shard SET number = 4294967297, count = 4294967298"}) {
    WriteShard();
    SqliteDatabase::OpenReadWrite(Path("b.db"), Path("b.db")).Execute(sql);
    ExpectRefused({{Path("a.db")}, {Path("b.db")}},
                  "b.db': the table mgsfm_shard is damaged",
                  "delete the file and run its share again");
  }
}

TEST_F(DatabaseMerging, ColmapOpensTheResult) {
  if (RunShell("command -v colmap").exit_code != 0) {
    GTEST_SKIP() << "colmap is not installed";
  }
  MakeDatabase("a.db", "seq1");
  MakeDatabase("b.db", "seq2");
  Merge("merged.db");
  const CommandOutput output = RunShell(
      "QT_QPA_PLATFORM=offscreen colmap database_cleaner --type matches "
      "--database_path " +
      Path("merged.db"));
  EXPECT_EQ(output.exit_code, 0) << output.err;
  FeatureDatabase database = Open("merged.db");
  EXPECT_TRUE(database.CountMatches().empty());
  EXPECT_EQ(database.ImagesWithKeypoints().size(), 8u);
}

}  // namespace
}  // namespace mgsfm

// SPDX-License-Identifier: BSD-3-Clause
// The commands that match, as users run them.
#include <cstdlib>
#include <sstream>
#include <vector>

#include "cli/running_program.h"
#include "database/sqlite_database.h"
#include "frontend/matching/feature_world.h"

namespace mgsfm {
namespace {

namespace fs = std::filesystem;
using testing::AllOf;
using testing::HasSubstr;
using testing::IsEmpty;
using testing::Matcher;

constexpr int kNumFrames = 4 * FeatureWorld::kFramesPerSide + 3;

// A rig that drives more than one lap, with features and without matches.
class MatcherCommands : public testing::Test {
 protected:
  static void SetUpTestSuite() {
    world_dir_ = new TempDir;
    FeatureDatabase database(WorldPath(), FeatureDatabase::OpenMode::kOrCreate);
    FeatureWorld(1).Write(&database, kNumFrames);
    for (const ImageRow& image : database.ReadStructure({}).images) {
      const int frame = std::atoi(image.name.c_str() + 5);
      database.WritePosePrior({image.id,
                               PosePriorRow::CoordinateSystem::kWgs84,
                               {49.0 + 9e-5 * frame, 8.4, 100.0},
                               {}});
    }
  }
  static void TearDownTestSuite() {
    delete world_dir_;
    world_dir_ = nullptr;
  }
  static std::string WorldPath() {
    return (world_dir_->path() / "world.db").string();
  }

  std::string Path(const std::string& name) const {
    return (dir_.path() / name).string();
  }
  // A fresh copy of the world.
  std::string Database(const std::string& name) const {
    fs::copy_file(WorldPath(), Path(name),
                  fs::copy_options::overwrite_existing);
    return Path(name);
  }
  static FeatureDatabase Open(const std::string& path) {
    return {path, FeatureDatabase::OpenMode::kExisting};
  }

  // Three frames in a row, by pairs.
  std::string WritePairs() const {
    std::ostringstream text;
    for (int frame = 0; frame < 3; ++frame) {
      text << FeatureWorld::ImageName(0, frame) << ' '
           << FeatureWorld::ImageName(0, frame + 1) << '\n';
    }
    WriteTextFile(Path("pairs.txt"), text.str());
    return Path("pairs.txt");
  }

  // The commands, each with flags that make few pairs.
  std::vector<std::string> AllCommands() const {
    return {"exhaustive_matcher --ExhaustiveMatching.block_size 20",
            "sequential_matcher --SequentialMatching.overlap 3",
            "vocab_tree_matcher --VocabTreeMatching.num_images 4",
            "spatial_matcher --SpatialMatching.max_distance 15",
            "matches_importer --match_list_path " + WritePairs()};
  }

  static CommandOutput Match(const std::string& command,
                             const std::string& database,
                             const std::string& more_flags = "") {
    return RunMgsfm(command + " --database_path " + database + " " +
                    more_flags);
  }

  // One line that tells it, and no file has changed.
  void ExpectRefused(const std::string& command, const std::string& database,
                     const Matcher<std::string>& message) const {
    const Files before = FilesIn(dir_.path());
    const CommandOutput output = Match(command, database);
    EXPECT_EQ(output.exit_code, 1) << command << output.err;
    EXPECT_THAT(output.out, IsEmpty());
    EXPECT_THAT(LastWord(output), message) << command << output.err;
    EXPECT_TRUE(FilesIn(dir_.path()) == before) << command;
  }

  // Sends the signal after the first pairs were written.
  static CommandOutput Interrupt(const std::string& database, int signal) {
    RunningProgram matcher({"exhaustive_matcher", "--database_path", database,
                            "--num_threads", "1", "--log_level", "debug"});
    matcher.WaitUntilItSays("pairs in the database");
    matcher.Send(signal);
    CommandOutput output = matcher.End();
    EXPECT_TRUE(matcher.EndedBySignal());
    EXPECT_EQ(output.exit_code, 128 + signal);
    return output;
  }

  const TempDir dir_;

 private:
  static TempDir* world_dir_;
};

TempDir* MatcherCommands::world_dir_ = nullptr;

TEST_F(MatcherCommands, ThreadsDoNotChangeTheDatabase) {
  for (const std::string& command : AllCommands()) {
    const std::string one = Database("one.db"), three = Database("three.db");
    const CommandOutput output = Match(command, one, "--num_threads 1");
    ASSERT_EQ(output.exit_code, 0) << command << output.err;
    EXPECT_THAT(output.err, HasSubstr("pairs verified"));
    ASSERT_EQ(Match(command, three, "--num_threads 3").exit_code, 0);
    EXPECT_FALSE(ReadGeometries(Open(one)).empty()) << command;
    EXPECT_TRUE(ReadTextFile(one) == ReadTextFile(three)) << command;
  }
}

TEST_F(MatcherCommands, TheSecondRunChangesNothing) {
  for (const std::string& command : AllCommands()) {
    const std::string database = Database("a.db");
    ASSERT_EQ(Match(command, database).exit_code, 0) << command;
    const std::string content = ReadTextFile(database);
    const CommandOutput again = Match(command, database);
    EXPECT_EQ(again.exit_code, 0) << command;
    EXPECT_THAT(again.err, HasSubstr("0 new pairs/s"));
    EXPECT_TRUE(ReadTextFile(database) == content) << command;
  }
}

TEST_F(MatcherCommands, ConfigFilesStandForFlags) {
  const std::string flags =
      "--SiftMatching.max_ratio 0.7 --TwoViewGeometry.min_num_inliers 30 "
      "--random_seed 5";
  const std::string by_flags = Database("flags.db");
  const std::string by_file = Database("file.db");
  const std::string command = "sequential_matcher";
  ASSERT_EQ(Match(command, by_flags, flags).exit_code, 0);
  const CommandOutput dump = Match(command, by_file, flags + " --dump_config");
  EXPECT_THAT(dump.out,
              AllOf(HasSubstr("max_ratio"), HasSubstr("min_num_inliers")));
  WriteTextFile(Path("config.ini"), dump.out);
  ASSERT_EQ(
      RunMgsfm(command + " --config_path " + Path("config.ini")).exit_code, 0);
  EXPECT_TRUE(ReadTextFile(by_flags) == ReadTextFile(by_file));
}

TEST_F(MatcherCommands, OptionsAreThoseOfColmap) {
  const std::vector<std::pair<std::string, std::vector<std::string>>> names = {
      {"exhaustive_matcher",
       {"SiftMatching.max_ratio", "SiftMatching.max_distance",
        "SiftMatching.cross_check", "SiftMatching.max_num_matches",
        "TwoViewGeometry.max_error", "TwoViewGeometry.confidence",
        "TwoViewGeometry.max_num_trials", "TwoViewGeometry.min_inlier_ratio",
        "TwoViewGeometry.min_num_inliers", "ExhaustiveMatching.block_size"}},
      {"sequential_matcher",
       {"SequentialMatching.overlap", "SequentialMatching.quadratic_overlap",
        "SequentialMatching.expand_rig_images",
        "SequentialMatching.loop_detection",
        "SequentialMatching.loop_detection_period",
        "SequentialMatching.loop_detection_num_images"}},
      {"vocab_tree_matcher",
       {"VocabTreeMatching.num_images", "VocabTreeMatching.max_num_features"}},
      {"spatial_matcher",
       {"SpatialMatching.ignore_z", "SpatialMatching.max_num_neighbors",
        "SpatialMatching.max_distance"}},
      {"matches_importer", {"match_list_path", "match_type"}}};
  for (const auto& [command, options] : names) {
    const std::string help = RunMgsfm(command + " --help_all").out;
    for (const std::string& option : options) {
      EXPECT_THAT(help, HasSubstr("--" + option + "\n")) << command;
    }
  }
}

// The database after a kill and a second run is that of one run.
TEST_F(MatcherCommands, AKilledRunGoesOn) {
  const std::string whole = Database("whole.db");
  ASSERT_EQ(Match("exhaustive_matcher", whole).exit_code, 0);
  const std::string database = Database("killed.db");
  Interrupt(database, SIGKILL);
  const size_t num_images = 2 * kNumFrames;
  const size_t num_pairs = num_images * (num_images - 1) / 2;
  {
    const FeatureDatabase killed = Open(database);
    const size_t num_done = killed.CountInlierMatches().size();
    EXPECT_GT(num_done, 0u);
    EXPECT_LT(num_done, num_pairs);
    EXPECT_EQ(killed.CountMatches().size(), num_done);
  }
  const CommandOutput output = Match("exhaustive_matcher", database);
  EXPECT_EQ(output.exit_code, 0) << output.err;
  const FeatureDatabase a = Open(whole), b = Open(database);
  EXPECT_EQ(b.CountMatches().size(), num_pairs);
  EXPECT_TRUE(AreEqual(ReadGeometries(a), ReadGeometries(b)));
  for (const PairCount& row : a.CountMatches()) {
    const auto expected = a.ReadMatches(row.image_id1, row.image_id2);
    const auto found = b.ReadMatches(row.image_id1, row.image_id2);
    EXPECT_EQ(found.size(), expected.size());
  }
}

TEST_F(MatcherCommands, AStoppedRunSaysThatItGoesOn) {
  const std::string database = Database("a.db");
  const CommandOutput output = Interrupt(database, SIGTERM);
  EXPECT_THAT(LastWord(output), AllOf(HasSubstr("stopped by signal 15"),
                                      HasSubstr("run the same command again")));
  EXPECT_FALSE(Open(database).CountMatches().empty());
}

// --------------------------------------------------------------- bad input

TEST_F(MatcherCommands, DatabasesThatCannotBeMatched) {
  WriteTextFile(Path("text.db"), "This is no database.");
  WriteTextFile(Path("empty.db"), "");
  const std::string without_images = Path("without_images.db");
  {
    FeatureDatabase empty(without_images, FeatureDatabase::OpenMode::kOrCreate);
    DatabaseTransaction(&empty).Commit();
  }
  for (const std::string& command : AllCommands()) {
    for (const char* name : {"none.db", "text.db"}) {
      ExpectRefused(command, Path(name), HasSubstr(Path(name)));
    }
    ExpectRefused(command, without_images,
                  AllOf(HasSubstr(without_images),
                        HasSubstr("run feature_extractor first")));
  }
}

TEST_F(MatcherCommands, FeaturesThatDoNotFit) {
  const std::string image = FeatureWorld::ImageName(0, 1);
  const std::string database = Database("a.db");
  {
    FeatureDatabase changed = Open(database);
    for (const ImageRow& row : changed.ReadStructure({}).images) {
      if (row.name != image) continue;
      changed.WriteDescriptors(row.id, DescriptorMatrix::Zero(3, 128));
    }
  }
  for (const std::string& command : AllCommands()) {
    ExpectRefused(
        command, database,
        AllOf(HasSubstr(image), HasSubstr("extract its features again")));
  }
}

TEST_F(MatcherCommands, NoPositions) {
  const std::string database = Path("a.db");
  {
    FeatureDatabase fresh(database, FeatureDatabase::OpenMode::kOrCreate);
    FeatureWorld(1).Write(&fresh, 2);
  }
  ExpectRefused("spatial_matcher", database,
                AllOf(HasSubstr("pose_priors"), HasSubstr("another matcher")));
}

TEST_F(MatcherCommands, ListsThatCannotBeRead) {
  const std::string database = Database("a.db");
  // As COLMAP 3.8 makes it: what is refused must not add the missing tables.
  SqliteDatabase::OpenReadWrite(database, database)
      .Execute(
          "DROP TABLE frame_data; DROP TABLE frames; DROP TABLE rig_sensors; "
          "DROP TABLE rigs; DROP TABLE pose_priors");
  const std::string list = Path("list.txt");
  const auto expect_refused = [&](const std::string& text,
                                  const std::string& type,
                                  const std::string& message) {
    WriteTextFile(list, text);
    ExpectRefused(
        "matches_importer --match_type " + type + " --match_list_path " + list,
        database, HasSubstr(message));
  };
  const std::string pair = "cam0/0000.png cam0/0001.png\n";
  expect_refused("cam0/0000.png\n", "pairs", "list.txt");
  expect_refused(pair + "cam0/0000.png none.png\n", "pairs", "line 2");
  expect_refused(pair + "0 x\n", "raw", "line 2");
  expect_refused(pair + "0 -1\n", "inliers", "line 2");
  expect_refused(pair + "0 999999\n", "raw", "999999");
  expect_refused(pair + "0 0\n\n" + pair + "1 1\n", "raw", "line 4");
  ExpectRefused("matches_importer --match_list_path " + Path("none.txt"),
                database, HasSubstr("none.txt"));
  ExpectRefused("matches_importer", database, HasSubstr("match_list_path"));
  ExpectRefused("matches_importer --match_type all --match_list_path " + list,
                database, AllOf(HasSubstr("'all'"), HasSubstr("inliers")));
}

TEST_F(MatcherCommands, OptionsOutOfRange) {
  const std::string database = Database("a.db");
  for (const char* flags :
       {"--SiftMatching.max_ratio 0", "--TwoViewGeometry.max_error -1",
        "--TwoViewGeometry.min_inlier_ratio 2",
        "--ExhaustiveMatching.block_size 0"}) {
    ExpectRefused(std::string("exhaustive_matcher ") + flags, database,
                  HasSubstr(std::string(flags).substr(
                      2, std::string(flags).rfind(' ') - 2)));
  }
}

TEST_F(MatcherCommands, AFileThatCannotBeWritten) {
  const std::string database = Database("a.db");
  fs::permissions(database, fs::perms::owner_read);
  if (geteuid() == 0) {
    GTEST_SKIP() << "root writes to every file";
  }
  ExpectRefused("exhaustive_matcher", database, HasSubstr(database));
}

}  // namespace
}  // namespace mgsfm

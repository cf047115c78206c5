// SPDX-License-Identifier: BSD-3-Clause
// Shards of features and matches: processes that are killed at random, and
// whose databases merge to the one of a single process.
#include <random>
#include <string>
#include <vector>

#include "cli/running_program.h"
#include "frontend/features/blob_images.h"
#include "frontend/matching/feature_world.h"
#include "mgsfm/models/model_io.h"
#include "support/database_rows.h"

namespace mgsfm {
namespace {

namespace fs = std::filesystem;
using testing::HasSubstr;

class Shards : public testing::Test {
 protected:
  std::string Path(const std::string& name) const {
    return (dir_.path() / name).string();
  }

  // Runs the command, killed up to twice before.
  void RunWithKills(const std::string& command) {
    const int num_kills = std::uniform_int_distribution<int>(0, 2)(random_);
    for (int i = 0; i < num_kills; ++i) {
      const double seconds =
          std::uniform_real_distribution<double>(0.0, 0.15)(random_);
      RunShell("timeout -s KILL " + std::to_string(seconds) +
               " " MGSFM_EXECUTABLE " " + command);
    }
    const CommandOutput output = RunMgsfm(command);
    ASSERT_EQ(output.exit_code, 0) << command << output.err;
  }

  // Runs all shares in a random order, and merges them in another one, with
  // `more` databases. "@" stands for the path of the shard.
  void RunShares(const std::string& command, int count,
                 const std::string& merged, const std::string& more = "") {
    std::vector<int> numbers(count);
    for (int i = 0; i < count; ++i) numbers[i] = i + 1;
    std::shuffle(numbers.begin(), numbers.end(), random_);
    std::string paths = more;
    for (const int number : numbers) {
      const std::string path =
          Path(merged + "." + std::to_string(number) + ".db");
      std::string line = command;
      line.replace(line.find('@'), 1, path);
      RunWithKills(line + " --shard " + std::to_string(number) + "/" +
                   std::to_string(count));
      paths = paths.empty() ? path : path + "," + paths;
    }
    Merge(paths, merged);
  }
  void Merge(const std::string& paths, const std::string& merged) const {
    const CommandOutput output =
        RunMgsfm("database_merger --database_path " + paths +
                 " --merged_database_path " + Path(merged));
    ASSERT_EQ(output.exit_code, 0) << output.err;
  }
  std::string MergeError(const std::string& paths) const {
    const CommandOutput output =
        RunMgsfm("database_merger --database_path " + paths +
                 " --merged_database_path " + Path("refused.db"));
    EXPECT_EQ(output.exit_code, 1) << output.err;
    EXPECT_FALSE(fs::exists(Path("refused.db")));
    return LastWord(output);
  }

  void WriteImage(const std::string& name, uint64_t seed, int width,
                  int height) const {
    const fs::path path = dir_.path() / "images" / name;
    fs::create_directories(path.parent_path());
    const GrayImage image =
        RenderBlobs(RandomBlobs(60, width, height, seed), width, height);
    std::string text =
        "P5 " + std::to_string(width) + " " + std::to_string(height) + " 255\n";
    text.append(reinterpret_cast<const char*>(image.data()),
                static_cast<size_t>(image.size()));
    WriteTextFile(path, text);
  }
  std::string Extract(const std::string& database) const {
    return "feature_extractor --database_path " + database + " --image_path " +
           Path("images");
  }

  // Features of a rig with known poses that drives more than one lap.
  void MakeWorld() const {
    {
      FeatureDatabase database(Path("world.db"),
                               FeatureDatabase::OpenMode::kOrCreate);
      FeatureWorld(1).Write(&database, 4 * FeatureWorld::kFramesPerSide + 3);
      for (const ImageRow& image : database.ReadStructure({}).images) {
        const int frame = std::atoi(image.name.c_str() + 5);
        database.WritePosePrior({image.id,
                                 PosePriorRow::CoordinateSystem::kCartesian,
                                 {2.0 * frame, 0.0, 0.0},
                                 {}});
      }
    }
    WriteTextFile(Path("rig.json"),
                  R"([{"cameras": [{"image_prefix": "cam0/",
        "ref_sensor": true}, {"image_prefix": "cam1/",
        "cam_from_rig_rotation": [1, 0, 0, 0],
        "cam_from_rig_translation": [-0.5, 0, 0]}]}])");
    const CommandOutput output =
        RunMgsfm("rig_configurator --database_path " + Path("world.db") +
                 " --rig_config_path " + Path("rig.json"));
    ASSERT_EQ(output.exit_code, 0) << output.err;
  }

  const TempDir dir_;
  std::mt19937 random_{1};
};

TEST_F(Shards, OfFeaturesMergeToTheDatabaseOfOneProcess) {
  for (int i = 0; i < 9; ++i) {
    // The camera of a folder is that of its first image that can be used;
    // images of other sizes are rejected.
    WriteImage("left/" + std::to_string(i) + ".pgm", i, 96, 80);
    WriteImage("right/" + std::to_string(i) + ".pgm", 20 + i,
               i == 1 ? 110 : 100, 80);
  }
  WriteTextFile(dir_.path() / "images/right/0.pgm", "no image");
  ASSERT_EQ(RunMgsfm(Extract(Path("single.db"))).exit_code, 0);
  for (const int count : {1, 3, 8, 25}) {
    const std::string merged = "merged" + std::to_string(count) + ".db";
    RunShares(Extract("@"), count, merged);
    ExpectEqualRows(Path("single.db"), Path(merged));
  }
}

TEST_F(Shards, OfMatchesMergeToTheDatabaseOfOneProcess) {
  MakeWorld();
  ASSERT_EQ(RunMgsfm("vocab_tree_builder --database_path " + Path("world.db") +
                     " --vocab_tree_path " + Path("tree.bin"))
                .exit_code,
            0);
  const std::string tree =
      " --VocabTree.vocab_tree_path " + Path("tree.bin") + " ";
  const std::vector<std::pair<std::string, int>> commands = {
      {"exhaustive_matcher", 3},
      {"sequential_matcher --SequentialMatching.overlap 3" + tree, 8},
      {"sequential_matcher --SequentialMatching.overlap 3" + tree, 1},
      {"vocab_tree_matcher --VocabTreeMatching.num_images 4" + tree, 3},
      {"spatial_matcher --SpatialMatching.max_distance 5", 8}};
  int k = 0;
  for (const auto& [command, count] : commands) {
    const std::string single = "single" + std::to_string(++k) + ".db";
    const std::string merged = "merged" + std::to_string(k) + ".db";
    fs::copy_file(Path("world.db"), Path(single));
    ASSERT_EQ(RunMgsfm(command + " --database_path " + Path(single)).exit_code,
              0);
    RunShares(
        command + " --database_path " + Path("world.db") + " --shard_path @",
        count, merged, Path("world.db"));
    ExpectEqualRows(Path(single), Path(merged));
    // Merged databases may be merged again.
    std::string all = Path(merged);
    for (int i = 1; i <= count; ++i) {
      all += "," + Path(merged + "." + std::to_string(i) + ".db");
    }
    Merge(all, "again.db");
    ExpectEqualRows(Path(single), Path("again.db"));
    fs::remove(Path("again.db"));
  }
}

TEST_F(Shards, SelectedPairsMatchAsTheMatcherDoes) {
  MakeWorld();
  const std::string flags =
      "sequential_matcher --SequentialMatching.overlap 3 --database_path ";
  ASSERT_EQ(RunMgsfm(flags + Path("world.db") + " --output_pairs_path " +
                     Path("pairs.txt"))
                .exit_code,
            0);
  RunShares("matches_importer --match_list_path " + Path("pairs.txt") +
                " --database_path " + Path("world.db") + " --shard_path @",
            3, "merged.db", Path("world.db"));
  ASSERT_EQ(RunMgsfm(flags + Path("world.db")).exit_code, 0);
  ExpectEqualRows(Path("world.db"), Path("merged.db"));
}

TEST_F(Shards, ContradictionsAreRefused) {
  MakeWorld();
  const std::string match =
      "spatial_matcher --SpatialMatching.max_distance 5 --database_path " +
      Path("world.db") + " --shard_path ";
  const auto run = [&](const std::string& line) {
    const CommandOutput output = RunMgsfm(line);
    return std::make_pair(output.exit_code, LastWord(output));
  };
  ASSERT_EQ(run(match + Path("1.db") + " --shard 1/2").first, 0);
  ASSERT_EQ(run(match + Path("2.db") + " --shard 2/2").first, 0);
  ASSERT_EQ(run(match + Path("other.db") +
                " --shard 2/2 --TwoViewGeometry.max_error 3")
                .first,
            0);
  const std::string world = Path("world.db") + ",";
  EXPECT_THAT(MergeError(world + Path("1.db")), HasSubstr("share 2/2"));
  EXPECT_THAT(MergeError(world + Path("1.db") + "," + Path("other.db")),
              HasSubstr("is missing"));
  EXPECT_THAT(MergeError(Path("1.db") + "," + Path("2.db")),
              HasSubstr("add the database"));
  // Another share, other options, or a file that is not a shard.
  EXPECT_THAT(run(match + Path("1.db") + " --shard 2/2").second,
              HasSubstr("holds share 1/2"));
  EXPECT_THAT(run(match + Path("1.db") + " --shard 1/2 --random_seed 7").second,
              HasSubstr("other images or options"));
  EXPECT_THAT(run(match + Path("world.db") + " --shard 1/2").second,
              HasSubstr("is not a shard"));
  EXPECT_THAT(run(match + Path("3.db") + " --shard 3/2").second,
              HasSubstr("1 <= i <= n"));
  EXPECT_THAT(
      run("spatial_matcher --shard 1/2 --database_path " + Path("world.db"))
          .second,
      HasSubstr("belong together"));
  // A shard of another database.
  {
    FeatureDatabase database(Path("world.db"),
                             FeatureDatabase::OpenMode::kExisting);
    database.AddImage("new.png", CameraId(1));
  }
  EXPECT_THAT(MergeError(world + Path("1.db") + "," + Path("2.db")),
              HasSubstr("match it again"));
}

TEST_F(Shards, UnfinishedOnesAreRefused) {
  MakeWorld();
  const std::string shard = Path("1.db");
  RunningProgram matcher({"exhaustive_matcher", "--database_path",
                          Path("world.db"), "--shard", "1/1", "--shard_path",
                          shard, "--num_threads", "1", "--log_level", "debug"});
  matcher.WaitUntilItSays("pairs in the database");
  matcher.Send(SIGKILL);
  matcher.End();
  EXPECT_THAT(MergeError(Path("world.db") + "," + shard),
              HasSubstr("is unfinished"));
}

// Two vehicles pass the same wall, 0.3 m farther from it the second time. Their
// images have the same names.
TEST_F(Shards, SessionsOfTwoVehiclesMakeOneMap) {
  MakeWorld();
  constexpr int kLap = 4 * FeatureWorld::kFramesPerSide, kNumFrames = 3;
  {
    const FeatureDatabase world(Path("world.db"),
                                FeatureDatabase::OpenMode::kReadOnly);
    const DatabaseContents contents = world.ReadStructure({});
    for (const auto& [name, first] : {std::pair("a.db", 0), {"b.db", kLap}}) {
      FeatureDatabase session(Path(name), FeatureDatabase::OpenMode::kOrCreate);
      const CameraId camera = session.AddCamera(contents.cameras[0]);
      for (const ImageRow& image : contents.images) {
        const int frame = std::atoi(image.name.c_str() + 5) - first;
        if (frame < 0 || frame >= kNumFrames) continue;
        const ImageId id = session.AddImage(
            FeatureWorld::ImageName(image.name[3] - '0', frame), camera);
        session.WriteKeypoints(id, world.ReadKeypoints(image.id));
        session.WriteDescriptors(id, world.ReadDescriptors(image.id));
      }
    }
  }
  for (const char* name : {"a.db", "b.db"}) {
    ASSERT_EQ(RunMgsfm("rig_configurator --database_path " + Path(name) +
                       " --rig_config_path " + Path("rig.json"))
                  .exit_code,
              0);
  }
  Merge(Path("a.db") + "," + Path("b.db") +
            " --image_prefix van/,bus/ --vehicle van,bus",
        "sessions.db");
  for (const std::string& command :
       {"vocab_tree_matcher --database_path " + Path("sessions.db"),
        "mapper --output_path " + Path("map") + " --database_path " +
            Path("sessions.db")}) {
    const CommandOutput output = RunMgsfm(command);
    ASSERT_EQ(output.exit_code, 0) << output.err;
  }
  const PoseModel map = ReadModelPoses(Path("map/0"));
  EXPECT_EQ(map.rigs.size(), 2u);
  ASSERT_EQ(map.images.size(), 4u * kNumFrames);
  const auto center = [&](const std::string& name) {
    const auto image = std::find_if(
        map.images.begin(), map.images.end(),
        [&](const ModelImage& other) { return other.name == name; });
    return image->cam_from_world.Inverse().translation;
  };
  // The known rig gives the unit; the world is that of the map.
  for (int sensor = 0; sensor < 2; ++sensor) {
    for (int frame = 0; frame < kNumFrames; ++frame) {
      const std::string name = FeatureWorld::ImageName(sensor, frame);
      EXPECT_NEAR((center("van/" + name) - center("bus/" + name)).norm(),
                  (FeatureWorld::Center(sensor, frame) -
                   FeatureWorld::Center(sensor, frame + kLap))
                      .norm(),
                  0.1)
          << name;
    }
  }
}

}  // namespace
}  // namespace mgsfm

// SPDX-License-Identifier: BSD-3-Clause
// Killed runs of the mapper continue from their checkpoints.
#include <chrono>
#include <fstream>
#include <thread>

#include "base/random.h"
#include "cli/running_program.h"
#include "cli/shared_drive.h"

namespace mgsfm {
namespace {

namespace fs = std::filesystem;
using testing::HasSubstr;

class CheckpointTest : public SharedDriveTest {
 protected:
  static void SetUpTestSuite() { SimulateLoop(); }
  std::vector<std::string> Mapper(const std::string& out) const {
    return {"mapper",
            "--database_path",
            Database(),
            "--output_path",
            Path(out),
            "--write_report",
            "0",
            "--checkpoint_path",
            Path(out + ".checkpoint"),
            "--PairFiltering.use_motion_continuity",
            "1",
            "--log_level",
            "debug"};
  }
  // Kills the mapper when it says this.
  void KillAt(const std::string& out, const std::string& text) const {
    RunningProgram killed(Mapper(out));
    killed.WaitUntilItSays(text);
    killed.Send(SIGKILL);
    killed.End();
    ASSERT_TRUE(killed.EndedBySignal());
  }
  CommandOutput Run(std::vector<std::string> arguments) const {
    RunningProgram program(std::move(arguments));
    return program.End();
  }
};

// The models; times and memory in the report differ from run to run.
Files ModelFiles(const std::string& folder) {
  Files files;
  for (const auto& entry : fs::recursive_directory_iterator(folder)) {
    const std::string name = fs::relative(entry.path(), folder).string();
    if (!entry.is_regular_file() || name == "report.json") continue;
    files[name] = ReadTextFile(entry.path());
  }
  return files;
}

TEST_F(CheckpointTest, KilledMapperContinuesToTheSameBytes) {
  const auto start = std::chrono::steady_clock::now();
  ASSERT_EQ(Run(Mapper("undisturbed")).exit_code, 0);
  const std::chrono::duration<double> whole =
      std::chrono::steady_clock::now() - start;
  EXPECT_FALSE(fs::exists(Path("undisturbed.checkpoint")));
  const Files expected = ModelFiles(Path("undisturbed"));
  ASSERT_FALSE(expected.empty());
  Random random(3);
  for (int i = 0; i < 4; ++i) {
    const std::string out = "killed" + std::to_string(i);
    {
      RunningProgram killed(Mapper(out));
      std::this_thread::sleep_for(whole * random.Uniform(0.1, 0.95));
      killed.Send(SIGKILL);
    }
    const CommandOutput resumed = Run(Mapper(out));
    ASSERT_EQ(resumed.exit_code, 0) << resumed.err;
    EXPECT_TRUE(ModelFiles(Path(out)) == expected) << resumed.err;
    EXPECT_FALSE(fs::exists(Path(out + ".checkpoint")));
  }
}

// Every stage that has ended comes from the checkpoint.
TEST_F(CheckpointTest, FinishedStagesAreNotRepeated) {
  KillAt("out", "solve 3:");
  const CommandOutput resumed = Run(Mapper("out"));
  ASSERT_EQ(resumed.exit_code, 0) << resumed.err;
  for (const char* stage :
       {"view graph", "rotation averaging", "moving objects", "tracks",
        "translation averaging"}) {
    EXPECT_THAT(resumed.err,
                HasSubstr(std::string(stage) + ": from the checkpoint"));
    EXPECT_THAT(resumed.err, Not(HasSubstr(std::string(stage) + " started")));
  }
  EXPECT_THAT(resumed.err, HasSubstr("solve 2 from the checkpoint"));
}

TEST_F(CheckpointTest, DamagedStageRunsAgain) {
  KillAt("out", "bundle adjustment started");
  const fs::path stage =
      fs::path(Path("out.checkpoint")) / "component_0_tracks.stage";
  ASSERT_TRUE(fs::exists(stage));
  std::fstream file(stage, std::ios::in | std::ios::out | std::ios::binary);
  file.seekp(static_cast<std::streamoff>(fs::file_size(stage) / 2));
  file.write("damaged", 7);
  file.close();
  const CommandOutput resumed = Run(Mapper("out"));
  EXPECT_EQ(resumed.exit_code, 0) << resumed.err;
  EXPECT_THAT(resumed.err, HasSubstr("is damaged and ignored"));
  EXPECT_THAT(resumed.err, HasSubstr("tracks started"));
  ASSERT_EQ(Run(Mapper("undisturbed")).exit_code, 0);
  EXPECT_TRUE(ModelFiles(Path("out")) == ModelFiles(Path("undisturbed")));
}

TEST_F(CheckpointTest, OtherOptionsAreRefused) {
  KillAt("out", "bundle adjustment started");
  std::vector<std::string> other = Mapper("out");
  other.insert(other.end(), {"--random_seed", "5"});
  const CommandOutput refused = Run(other);
  EXPECT_EQ(refused.exit_code, 1);
  EXPECT_THAT(LastWord(refused), HasSubstr("is of another database"));
  const CommandOutput resumed = Run(Mapper("out"));
  EXPECT_EQ(resumed.exit_code, 0) << resumed.err;
  EXPECT_THAT(resumed.err, HasSubstr("view graph: from the checkpoint"));
}

}  // namespace
}  // namespace mgsfm

// SPDX-License-Identifier: BSD-3-Clause
// A mapper that is told to stop, or killed.
#include <sstream>
#include <vector>

#include "cli/running_program.h"

namespace mgsfm {
namespace {

namespace fs = std::filesystem;
using testing::AllOf;
using testing::HasSubstr;

// A mapper beside an earlier output.
class Interruption : public testing::Test {
 protected:
  Interruption() {
    fs::copy_file(DemoDatabase(), Path("in.db"));
    fs::create_directories(Out() + "/0");
    WriteTextFile(Out() + "/0/images.bin", "earlier");
  }

  std::string Path(const std::string& name) const {
    return (dir_.path() / name).string();
  }
  std::string Out() const { return Path("out"); }

  // One picture under the names of all images. Points that take their colors
  // from large images keep a mapper busy for a while at its end.
  void PutImages() const {
    constexpr int kSize = 1000;
    std::ostringstream ppm;
    ppm << "P6 " << kSize << ' ' << kSize << " 255\n"
        << std::string(size_t{3} * kSize * kSize, '\x7f');
    WriteTextFile(Path("picture.ppm"), ppm.str());
    for (int sensor = 0; sensor < 4; ++sensor) {
      const fs::path folder =
          dir_.path() / "images" / ("cam" + std::to_string(sensor));
      fs::create_directories(folder);
      for (int frame = 0; frame < 24; ++frame) {
        const std::string number = std::to_string(frame);
        const std::string name =
            std::string(6 - number.size(), '0') + number + ".png";
        fs::create_symlink(Path("picture.ppm"), folder / name);
      }
    }
  }

  std::vector<std::string> MapperArguments() const {
    std::vector<std::string> arguments = {
        "mapper", "--database_path", Path("in.db"), "--output_path",
        Out(),    "--num_threads",   "1",           "--log_level",
        "debug"};
    if (fs::exists(Path("images"))) {
      arguments.insert(arguments.end(), {"--image_path", Path("images")});
    }
    return arguments;
  }

  void ExpectStopped(int signal, const std::string& when) const {
    const Files before = FilesIn(dir_.path());
    RunningProgram mapper(MapperArguments());
    mapper.WaitUntilItSays(when);
    mapper.Send(signal);
    const CommandOutput output = mapper.End();
    EXPECT_EQ(output.exit_code, 128 + signal) << when << output.err;
    EXPECT_TRUE(mapper.EndedBySignal());
    EXPECT_THAT(LastWord(output),
                AllOf(HasSubstr("stopped by signal " + std::to_string(signal)),
                      HasSubstr("nothing was written")));
    EXPECT_TRUE(FilesIn(dir_.path()) == before) << when;
  }

  const TempDir dir_;
};

constexpr const char* kStages[] = {
    "reading started",
    "rays started",
    "view graph started",
    "rotation averaging started",
    "tracks started",
    "translation averaging started",
    "bundle adjustment started",
};

TEST_F(Interruption, SigintInEachStageLeavesEverythingAsItWas) {
  for (const char* stage : kStages) ExpectStopped(SIGINT, stage);
  PutImages();
  ExpectStopped(SIGINT, "writing started");
}

TEST_F(Interruption, SigtermInEachStageLeavesEverythingAsItWas) {
  for (const char* stage : kStages) ExpectStopped(SIGTERM, stage);
  PutImages();
  ExpectStopped(SIGTERM, "writing started");
}

TEST_F(Interruption, SighupIsNoDifferent) {
  ExpectStopped(SIGHUP, "view graph started");
}

// `timeout` and terminals may do this.
TEST_F(Interruption, TheSameSignalTwiceAtATime) {
  RunningProgram mapper(MapperArguments());
  mapper.WaitUntilItSays("view graph started");
  for (int i = 0; i < 3; ++i) mapper.Send(SIGTERM);
  EXPECT_EQ(mapper.End().exit_code, 128 + SIGTERM);
  EXPECT_EQ(std::distance(fs::directory_iterator(Out()), {}), 1);
}

// nohup does this.
TEST_F(Interruption, SignalsThatTheCallerIgnoresStayIgnored) {
  std::signal(SIGHUP, SIG_IGN);
  {
    RunningProgram mapper(MapperArguments());
    mapper.WaitUntilItSays("view graph started");
    mapper.Send(SIGHUP);
    EXPECT_EQ(mapper.End().exit_code, 0);
  }
  std::signal(SIGHUP, SIG_DFL);
}

TEST_F(Interruption, AReaderOfTheLogThatGoesAwayDoesNotMatter) {
  const CommandOutput output =
      RunShell(MGSFM_EXECUTABLE " mapper --database_path " + Path("in.db") +
               " --output_path " + Out() + " --log_level debug 2>&1 | head -1");
  EXPECT_EQ(output.exit_code, 0);
  EXPECT_TRUE(fs::exists(Out() + "/report.json"));
}

// A killed run leaves its hidden folder; the next one clears it away.
TEST_F(Interruption, WhatAKilledRunLeavesIsRemovedByTheNextOne) {
  for (const bool is_new : {false, true}) {
    if (is_new) fs::remove_all(Out());
    const Files before = FilesIn(dir_.path());
    {
      RunningProgram mapper(MapperArguments());
      mapper.WaitUntilItSays("tracks started");
      mapper.Send(SIGKILL);
      EXPECT_EQ(mapper.End().exit_code, 128 + SIGKILL);
    }
    Files left = FilesIn(dir_.path());
    EXPECT_GT(left.size(), before.size());
    for (auto file = left.begin(); file != left.end();) {
      const bool is_hidden = file->first.find(".mgsfm-") != std::string::npos;
      file = is_hidden ? left.erase(file) : std::next(file);
    }
    EXPECT_TRUE(left == before);
    const CommandOutput output = RunMgsfm(
        "mapper --database_path " + Path("in.db") + " --output_path " + Out());
    EXPECT_EQ(output.exit_code, 0) << output.err;
    for (const auto& file : FilesIn(dir_.path())) {
      EXPECT_EQ(file.first.find(".mgsfm-"), std::string::npos) << file.first;
    }
  }
}

// The folder of a run that continues is left alone.
TEST_F(Interruption, TwoRunsWithOneOutputDoNotDisturbEachOther) {
  PutImages();  // the first run is the last to end
  RunningProgram mapper(MapperArguments());
  mapper.WaitUntilItSays("view graph started");
  EXPECT_EQ(RunMgsfm("mapper --database_path " + Path("in.db") +
                     " --output_path " + Out())
                .exit_code,
            0);
  const CommandOutput output = mapper.End();
  EXPECT_EQ(output.exit_code, 0) << output.err;
  EXPECT_TRUE(fs::exists(Out() + "/0/points3D.bin"));
}

}  // namespace
}  // namespace mgsfm

// SPDX-License-Identifier: BSD-3-Clause
// The built program reconstructs a model from a simulated database.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <filesystem>
#include <nlohmann/json.hpp>
#include <string>

#include "cli/program_runs.h"

namespace mgsfm {
namespace {

using ::testing::HasSubstr;
using ::testing::IsEmpty;

class EndToEnd : public ::testing::Test {
 protected:
  // Makes `folder`/database.db with a few frames of a stereo rig.
  void Simulate(const std::string& folder, const std::string& more_flags = "") {
    const CommandOutput output =
        Run("simulate --num_frames 6 --max_num_features 150 --output_path " +
            Path(folder) + " " + more_flags);
    ASSERT_EQ(output.exit_code, 0) << output.err;
  }
  CommandOutput Map(const std::string& folder, const std::string& model,
                    const std::string& more_flags = "") {
    return Run("mapper --database_path " + Path(folder) +
               "/database.db --output_path " + Path(model) + " " + more_flags);
  }
  CommandOutput Run(const std::string& arguments) {
    return RunExecutable(arguments);
  }
  std::string Path(const std::string& name) const {
    return (dir_.path() / name).string();
  }
  nlohmann::json Report(const std::string& model) const {
    return nlohmann::json::parse(ReadTextFile(Path(model) + "/report.json"));
  }

  TempDir dir_;
};

TEST_F(EndToEnd, WritesAModelTheRigAndAReport) {
  Simulate("in");
  const CommandOutput output = Map("in", "out");
  EXPECT_EQ(output.exit_code, 0) << output.err;
  EXPECT_THAT(output.out, IsEmpty());
  for (const char* name : {"cameras.bin", "images.bin", "points3D.bin",
                           "rigs.bin", "frames.bin", "rig_config.json"}) {
    EXPECT_GT(std::filesystem::file_size(Path("out") + "/0/" + name), 8u);
  }
  EXPECT_FALSE(std::filesystem::exists(Path("out") + "/1"));
  EXPECT_FALSE(Report("out").empty());
}

TEST_F(EndToEnd, ThreadsDoNotChangeTheModel) {
  Simulate("in", "--pixel_noise 0.5");
  ASSERT_EQ(Map("in", "one", "--num_threads 1").exit_code, 0);
  ASSERT_EQ(Map("in", "three", "--num_threads 3").exit_code, 0);
  for (const char* name : {"images.bin", "points3D.bin", "rigs.bin"}) {
    EXPECT_TRUE(ReadTextFile(Path("one") + "/0/" + name) ==
                ReadTextFile(Path("three") + "/0/" + name))
        << name;
  }
}

TEST_F(EndToEnd, Hazard15NothingToReconstructIsExitCode2) {
  Simulate("in", "--num_matched_frames 0 --match_different_sensors false");
  const CommandOutput output = Map("in", "out");
  EXPECT_EQ(output.exit_code, 2);
  EXPECT_THAT(output.err, HasSubstr("report.json"));
  EXPECT_FALSE(std::filesystem::exists(Path("out") + "/0"));
  EXPECT_FALSE(Report("out").empty());
}

TEST_F(EndToEnd, Hazard15BadInputIsExitCode1) {
  Simulate("in");
  ASSERT_EQ(Map("in", "out").exit_code, 0);
  const std::string before = ReadTextFile(Path("out") + "/0/images.bin");

  const CommandOutput missing = Map("none", "out");
  EXPECT_EQ(missing.exit_code, 1);
  EXPECT_THAT(missing.err, HasSubstr(Path("none")));
  EXPECT_EQ(Map("in", "out", "--Tracks.min_track_length=1").exit_code, 1);
  EXPECT_EQ(Map("in", "out", "--rig_config_path " + Path("none")).exit_code, 1);

  EXPECT_TRUE(ReadTextFile(Path("out") + "/0/images.bin") == before);
  // Nor is anything left beside it.
  size_t num_entries = 0;
  for ([[maybe_unused]] const auto& entry :
       std::filesystem::directory_iterator(dir_.path())) {
    ++num_entries;
  }
  EXPECT_EQ(num_entries, 2u);
}

TEST_F(EndToEnd, ReportHoldsTheOptionsThatWereUsed) {
  Simulate("in");
  WriteTextFile(Path("config.ini"),
                "min_num_frames = 3\n[Tracks]\nmin_track_length = 4\n");
  ASSERT_EQ(
      Map("in", "out", "--min_num_frames 2 --config_path " + Path("config.ini"))
          .exit_code,
      0);
  const nlohmann::json options = Report("out")["options"];
  EXPECT_EQ(options["min_num_frames"], 2);
  EXPECT_EQ(options["Tracks"]["min_track_length"], 4);
}

}  // namespace
}  // namespace mgsfm

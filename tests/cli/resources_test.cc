// SPDX-License-Identifier: BSD-3-Clause
// Behavior of the program when the system refuses memory, threads, or a place
// for its messages, and under conventions of other languages and users.
#include <sys/stat.h>

#include <clocale>
#include <cstdlib>
#include <locale>

#include "cli/program_runs.h"

namespace mgsfm {
namespace {

namespace fs = std::filesystem;
using testing::AnyOf;
using testing::Eq;
using testing::HasSubstr;

class Resources : public testing::Test {
 protected:
  std::string Path(const std::string& name) const {
    return (dir_.path() / name).string();
  }
  std::string Map(const std::string& output) const {
    return "mapper --database_path " + DemoDatabase() + " --output_path " +
           Path(output) + " --num_threads 2";
  }
  std::string Adjust(const std::string& output) const {
    return "bundle_adjuster --input_path " + DemoTruth() + " --output_path " +
           Path(output);
  }

  const TempDir dir_;
};

#ifndef __SANITIZE_ADDRESS__  // sanitizers need terabytes of addresses
// At each limit, the output is complete, or one line tells why there is none.
void LimitMemory(const std::string& arguments, const fs::path& output_path,
                 const fs::path& written_file, const char* complete = "") {
  int num_refused = 0, num_written = 0;
  for (int limit_mib = 90; limit_mib <= 500;
       limit_mib += num_written > 3 ? 50 : limit_mib / 20) {
    const std::string limit = "ulimit -v " + std::to_string(1024 * limit_mib);
    // Libraries take addresses before the program begins.
    if (RunShell(limit + "; " MGSFM_EXECUTABLE " --version").exit_code != 0) {
      continue;
    }
    const CommandOutput output = RunShell(
        limit + "; timeout -k 1 120 " MGSFM_EXECUTABLE " " + arguments);
    ASSERT_THAT(output.exit_code, AnyOf(Eq(0), Eq(1)))
        << limit_mib << output.err;
    if (output.exit_code == 0) {
      EXPECT_TRUE(fs::exists(written_file)) << limit_mib;
      EXPECT_THAT(output.err, HasSubstr(complete)) << limit_mib;
      ++num_written;
    } else {
      EXPECT_THAT(LastWord(output), HasSubstr("ulimit")) << output.err;
      ++num_refused;
    }
    fs::remove_all(output_path);
  }
  EXPECT_GE(num_refused, 1);
  EXPECT_GE(num_written, 1);
}

TEST_F(Resources, LittleMemoryIsNoHang) {
  LimitMemory(Map("out"), Path("out"), Path("out/0/images.bin"));
}

// OpenCV has an exception of its own for a lack of memory.
TEST_F(Resources, LittleMemoryForImages) {
  fs::create_directories(Path("images"));
  std::string image = "P5 400 300 255\n";
  for (int i = 0; i < 400 * 300; ++i) {
    image += static_cast<char>(i * i % 251);
  }
  WriteTextFile(Path("images/a.pgm"), image);
  LimitMemory("feature_extractor --num_threads 1 --image_path " +
                  Path("images") + " --database_path " + Path("a.db"),
              Path("a.db"), Path("a.db"), "0 were rejected");
}
#endif

TEST_F(Resources, AClosedOutputDoesNotHarmAWrittenModel) {
  for (const char* redirection : {" >/dev/full", " >&-"}) {
    const CommandOutput output =
        RunShell(MGSFM_EXECUTABLE " " + Adjust("out") + redirection);
    EXPECT_EQ(output.exit_code, 0) << output.err;
    EXPECT_THAT(output.err, HasSubstr("the model is complete"));
    EXPECT_TRUE(fs::exists(Path("out/images.bin")));
    // There, the table is the result.
    EXPECT_EQ(RunShell(MGSFM_EXECUTABLE " model_evaluator --input_path " +
                       Path("out") + " --gt_path " + DemoTruth() + redirection)
                  .exit_code,
              1);
    fs::remove_all(Path("out"));
  }
}

TEST_F(Resources, NewFoldersHaveThePermissionsOfTheUser) {
  for (const mode_t mask : {077, 022, 007}) {
    const mode_t before = umask(mask);
    ASSERT_EQ(RunMgsfm(Adjust("deep/model")).exit_code, 0);
    ASSERT_EQ(RunMgsfm(Map("run")).exit_code, 0);
    umask(before);
    for (const char* name : {"deep", "deep/model", "run", "run/0"}) {
      struct stat status {};
      ASSERT_EQ(stat(Path(name).c_str(), &status), 0);
      EXPECT_EQ(status.st_mode & 0777, 0777 & ~mask) << name;
    }
    fs::remove_all(Path("deep"));
    fs::remove_all(Path("run"));
  }
}

struct CommaPunctuation : std::numpunct<char> {
  char do_decimal_point() const override { return ','; }
  char do_thousands_sep() const override { return '.'; }
  std::string do_grouping() const override { return "\3"; }
};

// Runs in this process, so that they have its locale.
Files FilesOfAllCommands(const fs::path& folder) {
  const std::string out = folder.string();
  const std::string calls[] = {
      "simulate --output_path " + out +
          "/drive --num_frames 8 --pixel_noise 0.5 --gravity_sigma 0.5 "
          "--prior_sigma 0.25 --rig stereo",
      "mapper --database_path " + out + "/drive/database.db --output_path " +
          out +
          "/run --output_format txt --compute_covariances 1 "
          "--gravity_path " +
          out +
          "/drive/gravity.txt "
          "--image_timestamps_path " +
          out + "/drive/timestamps.txt",
      "bundle_adjuster --input_path " + out + "/run/0 --output_path " + out +
          "/adjusted",
      "model_evaluator --input_path " + out + "/adjusted --gt_path " + out +
          "/drive/truth --position_thresholds 0.05,1.5 --json " + out +
          "/errors.json --svg_path " + out + "/errors.svg"};
  for (const std::string& call : calls) {
    const CommandOutput output = RunMgsfm(call);
    EXPECT_EQ(output.exit_code, 0) << call << output.err;
  }
  Files files;
  for (const auto& [path, content] : FilesIn(folder)) {
    // Reports and pages have times and paths.
    if (path.find("report.") != std::string::npos) continue;
    files[path.substr(out.size())] = content;
  }
  return files;
}

TEST_F(Resources, FilesDoNotDependOnTheLocale) {
  fs::create_directory(Path("classic"));
  fs::create_directory(Path("comma"));
  const Files expected = FilesOfAllCommands(Path("classic"));
  const std::locale before =
      std::locale::global(std::locale(std::locale(), new CommaPunctuation));
  // The locale of C++ is tested alone if localedef cannot make this one.
  if (RunShell("localedef -i de_DE -f UTF-8 " + Path("de_DE.UTF-8"))
          .exit_code == 0) {
    setenv("LOCPATH", dir_.path().c_str(), 1);
    ASSERT_NE(std::setlocale(LC_ALL, "de_DE.UTF-8"), nullptr);
    EXPECT_EQ(std::strtod("1,5", nullptr), 1.5);
  }
  const Files files = FilesOfAllCommands(Path("comma"));
  std::setlocale(LC_ALL, "C");
  unsetenv("LOCPATH");
  std::locale::global(before);
  ASSERT_EQ(files.size(), expected.size());
  for (const auto& [path, content] : files) {
    EXPECT_TRUE(content == expected.at(path)) << path;
  }
}

}  // namespace
}  // namespace mgsfm

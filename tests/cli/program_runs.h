// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <fcntl.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <sys/wait.h>
#include <unistd.h>

#include <algorithm>
#include <cstdio>
#include <filesystem>
#include <iomanip>
#include <iostream>
#include <map>
#include <sstream>
#include <string>
#include <vector>

#include "program.h"
#include "support/subprocess.h"

#ifdef MGSFM_COVERAGE
extern "C" void __gcov_dump();  // of libgcov
#endif

namespace mgsfm {

// Ends the process with the exit code of the program, which writes to files.
[[noreturn]] inline void BecomeMgsfm(const std::vector<std::string>& arguments,
                                     const std::string& out_path,
                                     const std::string& err_path) {
  constexpr int kFlags = O_WRONLY | O_CREAT | O_TRUNC;
  const bool is_redirected =
      dup2(open(out_path.c_str(), kFlags, 0600), STDOUT_FILENO) >= 0 &&
      dup2(open(err_path.c_str(), kFlags, 0600), STDERR_FILENO) >= 0;
  if (!is_redirected) _exit(127);
  const int exit_code = RunProgram(arguments);
  std::cout.flush();
  std::fflush(nullptr);
#ifdef MGSFM_COVERAGE
  __gcov_dump();  // _exit() would lose the counts
#endif
  _exit(exit_code);
}

// Runs the program in a process of its own, without the time that loading its
// shared libraries again takes. Arguments may stand in '...'.
inline CommandOutput RunMgsfm(const std::string& arguments) {
  std::vector<std::string> words;
  std::istringstream text(arguments);
  for (std::string word; text >> std::quoted(word, '\'');) {
    words.push_back(word);
  }
  const TempDir dir;
  const std::string out_path = (dir.path() / "out").string();
  const std::string err_path = (dir.path() / "err").string();
  std::cout.flush();
  std::fflush(nullptr);
  const pid_t pid = fork();
  MGSFM_CHECK(pid >= 0);
  if (pid == 0) BecomeMgsfm(words, out_path, err_path);
  int status = 0;
  MGSFM_CHECK(waitpid(pid, &status, 0) == pid);
  return {ExitCodeOf(status), ReadTextFile(out_path), ReadTextFile(err_path)};
}

// Runs the built program itself.
inline CommandOutput RunExecutable(const std::string& arguments) {
  return RunShell(MGSFM_EXECUTABLE " " + arguments);
}

// Runs commands that succeed, with a folder for their files.
class CommandTest : public testing::Test {
 protected:
  std::string Path(const std::string& name) const {
    return (dir_.path() / name).string();
  }
  CommandOutput Run(const std::string& arguments) const {
    const CommandOutput output = RunMgsfm(arguments);
    EXPECT_EQ(output.exit_code, 0) << arguments << output.err;
    return output;
  }

  const TempDir dir_;
};

// Contents of all files below a folder, including hidden ones; links are not
// followed.
using Files = std::map<std::string, std::string>;
inline Files FilesIn(const std::filesystem::path& folder) {
  Files files;
  for (const auto& entry :
       std::filesystem::recursive_directory_iterator(folder)) {
    const bool is_file = entry.is_regular_file() && !entry.is_symlink();
    files[entry.path().string()] = is_file ? ReadTextFile(entry.path()) : "";
  }
  return files;
}

// The last message of the program: log lines aside, one line that begins with
// its name. "" if it says anything else, or more.
inline std::string LastWord(const CommandOutput& output) {
  const size_t begin = output.err.find("mgsfm: ");
  if (begin == std::string::npos) return "";
  const bool is_line = begin == 0 || output.err[begin - 1] == '\n';
  const std::string last = output.err.substr(begin);
  const bool is_one_line =
      std::count(last.begin(), last.end(), '\n') == 1 && last.back() == '\n';
  return is_line && is_one_line ? last : "";
}

// The drive that comes with the project: 24 frames of four cameras.
inline std::string DemoDatabase() {
  return MGSFM_SOURCE_DIR "/data/demo/database.db";
}
inline std::string DemoTruth() { return MGSFM_SOURCE_DIR "/data/demo/truth"; }

}  // namespace mgsfm

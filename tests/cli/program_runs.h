// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <filesystem>
#include <map>
#include <string>

#include "support/subprocess.h"

namespace mgsfm {

// Runs the built program.
inline CommandOutput RunMgsfm(const std::string& arguments) {
  return RunShell(MGSFM_EXECUTABLE " " + arguments);
}

// All files below a folder, hidden ones too, with what they hold; links are not
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

// What the program says at last: log lines aside, one line that begins with its
// name. "" if it says anything else, or more.
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

// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <gtest/gtest.h>

#include <filesystem>
#include <map>
#include <string>

#include "files/staged_output.h"
#include "io/test_database.h"
#include "support/temp_dir.h"

namespace mgsfm {

using Files = std::map<std::string, std::string>;

// Contents of all files below a folder, including hidden ones, and empty
// folders.
inline Files FilesIn(const std::filesystem::path& folder) {
  Files files;
  for (const auto& entry :
       std::filesystem::recursive_directory_iterator(folder)) {
    const std::string name =
        std::filesystem::relative(entry.path(), folder).string();
    if (entry.is_regular_file()) files[name] = ReadTextFile(entry.path());
    if (entry.is_directory() && std::filesystem::is_empty(entry.path()))
      files[name] = "";
  }
  return files;
}

class StagedOutputTest : public testing::Test {
 protected:
  static void Put(const std::filesystem::path& path, const std::string& text) {
    std::filesystem::create_directories(path.parent_path());
    WriteTextFile(path, text);
  }
  void WriteNewModel(const std::filesystem::path& target) {
    StagedOutput output(target);
    Put(output.StagingDir() / "0" / "images.bin", "new");
    Put(output.StagingDir() / "report.json", "new");
    output.Commit();
  }

  const TempDir dir_;
  const std::filesystem::path target_ = dir_.path() / "out";
};

}  // namespace mgsfm

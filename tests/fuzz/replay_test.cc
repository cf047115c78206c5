// SPDX-License-Identifier: BSD-3-Clause
#include <gtest/gtest.h>

#include <algorithm>
#include <filesystem>
#include <iostream>

#include "fuzz/fuzz_target.h"

namespace mgsfm {
namespace {

std::vector<std::filesystem::path> FilesOf(const std::string& target) {
  std::vector<std::filesystem::path> files;
  for (const auto& entry : std::filesystem::directory_iterator(
           std::filesystem::path(MGSFM_SOURCE_DIR) / "tests" / "fuzz" /
           "corpus" / target)) {
    files.push_back(entry.path());
  }
  std::sort(files.begin(), files.end());
  return files;
}

// The seeds, and one file for each failure that fuzzing has found. A violated
// check ends the process, after the name of the file.
TEST(FuzzCorpus, IsReadOrRejected) {
  ASSERT_FALSE(FuzzTargets().empty());
  for (const FuzzTarget& target : FuzzTargets()) {
    const std::vector<std::filesystem::path> files = FilesOf(target.name);
    EXPECT_GT(files.size(), 1u) << target.name;
    for (const std::filesystem::path& file : files) {
      std::cout << file.string() << std::endl;
      target.run(ReadTextFile(file));
    }
    target.run("");
  }
}

}  // namespace
}  // namespace mgsfm

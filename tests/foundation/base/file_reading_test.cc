// SPDX-License-Identifier: BSD-3-Clause
#include "base/file_reading.h"

#include <gtest/gtest.h>
#include <sys/stat.h>

#include <thread>

#include "support/temp_dir.h"

namespace mgsfm {
namespace {

// A process substitution of a shell is a pipe, which ends after one reader.
TEST(ReadFile, EveryStepReadsAPipe) {
  const TempDir dir;
  const std::filesystem::path path = dir.path() / "pipe";
  ASSERT_EQ(mkfifo(path.c_str(), 0600), 0);
  const std::string text(100000, 'x');
  std::thread writer([&] { WriteTextFile(path.string(), text); });
  EXPECT_EQ(ReadFile(path, "", 10), text.substr(0, 10));
  writer.join();
  EXPECT_EQ(ReadFile(path), text);
  EXPECT_EQ(ReadFile(path, "the pipe"), text);
}

// As in a process that goes on, such as Python.
TEST(ReadFile, APipeOfTheSameNameIsAnother) {
  const TempDir dir;
  const std::filesystem::path path = dir.path() / "pipe";
  const std::filesystem::path kept = dir.path() / "kept";
  for (const std::string text : {"first", "second"}) {
    ASSERT_EQ(mkfifo(path.c_str(), 0600), 0);
    std::thread writer([&] { WriteTextFile(path.string(), text); });
    EXPECT_EQ(ReadFile(path), text);
    writer.join();
    // Its inode stays in use.
    std::filesystem::rename(path, kept);
  }
}

}  // namespace
}  // namespace mgsfm

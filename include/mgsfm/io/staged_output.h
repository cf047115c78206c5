// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <filesystem>

namespace mgsfm {

// Output that appears as a whole or not at all. Files are written into a
// temporary folder beside the target; Commit() moves its entries to the target,
// replacing those of the same name and the numbered model folders ("0", "1",
// ...) of an earlier run. Other files in the target stay. Without Commit()
// nothing there changes, and the temporary folder is removed.
class StagedOutput {
 public:
  // Throws Error if the target is a file or nothing can be written beside it.
  explicit StagedOutput(const std::filesystem::path& target);
  ~StagedOutput();
  StagedOutput(const StagedOutput&) = delete;
  StagedOutput& operator=(const StagedOutput&) = delete;

  const std::filesystem::path& StagingDir() const { return staging_; }

  // What is replaced is put aside first, and put back if a move fails; then
  // throws Error.
  void Commit();

 private:
  std::filesystem::path target_;
  std::filesystem::path staging_;
};

}  // namespace mgsfm

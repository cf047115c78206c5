// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <filesystem>
#include <vector>

namespace mgsfm {

// Output that appears as a whole or not at all. Files are written into a
// temporary folder; Commit() makes it the target or, if the target exists,
// moves its entries there, replacing those of the same name and the models
// ("0", "1", ...) of an earlier run. Other files in the target stay. Without
// Commit() nothing there changes. The temporary folder, which is hidden and
// lies in the target or, if that is new, beside it, is removed at the end.
class StagedOutput {
 public:
  // Throws Error if the target is a file, if it holds something called like a
  // model that is none, or if nothing can be written there.
  explicit StagedOutput(const std::filesystem::path& target);
  ~StagedOutput();
  StagedOutput(const StagedOutput&) = delete;
  StagedOutput& operator=(const StagedOutput&) = delete;

  const std::filesystem::path& StagingDir() const { return staging_; }

  // To be called once. What is replaced is put aside first, and put back if a
  // move fails; then throws Error.
  void Commit();

 private:
  void RemoveNewParents();

  std::filesystem::path target_;
  std::filesystem::path staging_;
  // Folders made above a new target, the lowest first.
  std::vector<std::filesystem::path> new_parents_;
};

}  // namespace mgsfm

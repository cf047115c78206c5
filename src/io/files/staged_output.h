// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <filesystem>
#include <memory>
#include <vector>

namespace mgsfm {

class FolderLock;

// What of an earlier run is obsolete, beside files of the same name.
enum class ObsoleteOutput {
  kModels,      // folders "0", "1", ... that hold models
  kModelFiles,  // the target is a model: its files, binary or text
};

// Output that appears as a whole or not at all. Files are written into a
// temporary folder; Commit() makes it the target or, if the target exists,
// moves its entries there, replacing those of the same name and what is
// obsolete. Other files in the target stay. Without
// Commit() nothing there changes. The temporary folder, which is hidden and
// lies in the target or, if that is new, beside it, is removed at the end. If
// the process is killed it stays, and is removed by the next one with the same
// target.
class StagedOutput {
 public:
  // Throws Error if the target is a file, if it holds something called like a
  // model that is none, if nothing can be written there, or if a process was
  // killed in the middle of Commit(), which is for the user to sort out.
  explicit StagedOutput(const std::filesystem::path& target,
                        ObsoleteOutput obsolete = ObsoleteOutput::kModels);
  ~StagedOutput();
  StagedOutput(const StagedOutput&) = delete;
  StagedOutput& operator=(const StagedOutput&) = delete;

  const std::filesystem::path& StagingDir() const { return staging_; }

  // To be called once. What is replaced is put aside first, and put back if a
  // move fails; then throws Error.
  void Commit();

 private:
  void MakeStagingDir(const std::filesystem::path& parent);
  void RemoveNewParents();
  bool IsObsolete(const std::filesystem::path& entry) const;

  std::filesystem::path target_;
  const ObsoleteOutput obsolete_;
  std::filesystem::path staging_;
  std::unique_ptr<FolderLock> lock_;  // on staging_, while this object lives
  // Folders made above a new target, the lowest first.
  std::vector<std::filesystem::path> new_parents_;
};

}  // namespace mgsfm

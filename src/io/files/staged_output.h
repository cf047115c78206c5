// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <filesystem>
#include <functional>
#include <memory>
#include <string>
#include <vector>

#include "files/file_operations.h"
#include "files/model_files.h"

namespace mgsfm {

// An advisory lock on a folder (flock). The system releases it when the owner
// ends for any reason. Unlike a process id, it is unambiguous across processes,
// containers and machines.
class FolderLock {
 public:
  enum class State {
    kHeld,         // held by this object
    kBusy,         // held by another process, or the folder is gone
    kUnsupported,  // the folder cannot be locked at all
  };

  enum class Wait { kNo, kYes };

  explicit FolderLock(const std::filesystem::path& folder,
                      Wait wait = Wait::kNo);
  ~FolderLock();
  FolderLock(const FolderLock&) = delete;
  FolderLock& operator=(const FolderLock&) = delete;

  State state() const { return state_; }

 private:
  const int fd_;
  State state_ = State::kBusy;
};

// Output of which each model and each file appears as a whole or not at all.
// Files are written into a hidden temporary folder; Commit() puts its entries
// in their places.
//
// A model replaces its folder by one exchange (renameat2) or, where the file
// system cannot, by two renames. Other files in the folder remain: the new
// folder has links to them. Models of an earlier run that have no successor are
// removed. Everything else in the target remains.
//
// If a call fails, the target is restored. A killed process leaves complete
// models of the earlier output or of this one; the next process with the same
// target restores entries that were taken without a successor.
class StagedOutput {
 public:
  // First cleans up after killed processes. Throws Error
  // - if the target is a file, or nothing can be written there,
  // - if the output would replace something that is not a model,
  // - if a folder to replace is a link, a mount point or the working folder.
  // `operations` must outlive the object; by default, they act on real files.
  explicit StagedOutput(const std::filesystem::path& target,
                        OutputKind kind = OutputKind::kRun,
                        FileOperations* operations = nullptr);
  // Removes the temporary folder.
  ~StagedOutput();
  StagedOutput(const StagedOutput&) = delete;
  StagedOutput& operator=(const StagedOutput&) = delete;

  std::filesystem::path StagingDir() const;

  // May be called once. Throws Error if a call fails, after restoring the
  // target.
  void Commit();

 private:
  void RemoveStale(const std::filesystem::path& folder) const;
  void MakeWorkFolder();
  void CheckTarget();
  void PrepareEntry(const std::string& name);
  void PrepareObsoleteModels();
  void Move(const std::filesystem::path& from, const std::filesystem::path& to);
  void Place(const std::string& name);
  void PlaceAll();
  void RemoveFolders() const;

  FileOperations default_operations_;
  FileOperations* const operations_;
  std::filesystem::path target_;
  const OutputKind kind_;
  // The folder of the entries to place: an existing target of kRun, which may
  // be a mount point, or else the parent of the target.
  std::filesystem::path base_;
  // The hidden folder in base_. work_/new/NAME will become base_/NAME, and
  // work_/old/NAME was base_/NAME.
  std::filesystem::path work_;
  std::unique_ptr<FolderLock> lock_;   // on work_, while this object lives
  std::vector<std::string> obsolete_;  // names of entries to remove
  std::vector<std::function<void()>> undo_;
  bool is_tidy_ = true;  // false: work_ holds what belongs into base_
  // New parent folders of the target, the lowest first.
  std::vector<std::filesystem::path> new_parents_;
};

}  // namespace mgsfm

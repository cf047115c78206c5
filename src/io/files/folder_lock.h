// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <filesystem>

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

}  // namespace mgsfm

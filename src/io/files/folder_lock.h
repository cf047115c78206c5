// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <filesystem>

namespace mgsfm {

// An advisory lock on a folder (flock). The system drops it when its owner
// ends, however that ends; unlike a process id it cannot be mistaken for that
// of another process, nor of one in another container or machine.
class FolderLock {
 public:
  enum class State {
    kHeld,         // by this object
    kBusy,         // by somebody else, or the folder is gone
    kUnsupported,  // the folder cannot be locked at all
  };

  enum class Wait { kNo, kYes };

  FolderLock() = default;
  explicit FolderLock(const std::filesystem::path& folder,
                      Wait wait = Wait::kNo);
  ~FolderLock();
  FolderLock(FolderLock&& other) noexcept;
  FolderLock& operator=(FolderLock&& other) noexcept;

  State state() const { return state_; }

 private:
  int fd_ = -1;
  State state_ = State::kBusy;
};

}  // namespace mgsfm

// SPDX-License-Identifier: BSD-3-Clause
#include "files/folder_lock.h"

#include <fcntl.h>
#include <sys/file.h>
#include <sys/stat.h>
#include <unistd.h>

#include <cerrno>
namespace mgsfm {
namespace {

// Returns whether the name still refers to the open folder. Its last owner may
// have removed it between opening and locking.
bool IsSameFolder(int fd, const std::filesystem::path& folder) {
  struct stat open_folder, named_folder;
  return fstat(fd, &open_folder) == 0 &&
         stat(folder.c_str(), &named_folder) == 0 &&
         open_folder.st_dev == named_folder.st_dev &&
         open_folder.st_ino == named_folder.st_ino;
}

}  // namespace

FolderLock::FolderLock(const std::filesystem::path& folder, Wait wait)
    : fd_(open(folder.c_str(),
               O_RDONLY | O_DIRECTORY | O_NOFOLLOW | O_CLOEXEC)) {
  if (fd_ < 0) {
    if (errno != ENOENT) state_ = State::kUnsupported;
    return;
  }
  const int flags = wait == Wait::kYes ? LOCK_EX : LOCK_EX | LOCK_NB;
  int result = 0;
  do {
    result = flock(fd_, flags);
  } while (result != 0 && errno == EINTR);
  if (result == 0) {
    if (IsSameFolder(fd_, folder)) state_ = State::kHeld;
  } else if (errno != EWOULDBLOCK) {
    state_ = State::kUnsupported;
  }
}

FolderLock::~FolderLock() {
  if (fd_ >= 0) close(fd_);
}

}  // namespace mgsfm

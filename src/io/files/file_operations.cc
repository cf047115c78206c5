// SPDX-License-Identifier: BSD-3-Clause
#include "files/file_operations.h"

#include <fcntl.h>
#include <sys/stat.h>
#include <unistd.h>

#include <cerrno>
#include <cstdio>
#include <fstream>
#include <system_error>
#include <vector>

#include "mgsfm/base/error.h"

namespace mgsfm {

void ThrowWriteError(const std::filesystem::path& path) {
  const int reason = errno;
  std::string message = "cannot write '" + path.string() + "'";
  if (reason != 0) message += ": " + std::generic_category().message(reason);
  const bool is_full = reason == ENOSPC || reason == EDQUOT || reason == EFBIG;
  throw Error(message + (is_full ? "; free some space or choose another path"
                                 : "; choose another path"));
}

void WriteFile(const std::filesystem::path& path, const std::string& content) {
  errno = 0;
  std::ofstream file(path, std::ios::binary | std::ios::trunc);
  file << content;
  file.close();
  if (!file) ThrowWriteError(path);
}

namespace {

namespace fs = std::filesystem;

[[noreturn]] void ThrowError(const std::string& what, int reason) {
  throw Error("cannot " + what + ": " +
              std::generic_category().message(reason));
}

std::string Quoted(const fs::path& path) { return "'" + path.string() + "'"; }

// Some file systems cannot sync a folder and return these errors.
bool IsSyncUnsupported(int reason) {
  return reason == EINVAL || reason == ENOTSUP || reason == EROFS ||
         reason == EBADF;
}

std::vector<fs::path> EntriesOf(const fs::path& folder) {
  std::vector<fs::path> entries;
  std::error_code error;
  for (fs::directory_iterator it(folder, error), end; !error && it != end;
       it.increment(error)) {
    entries.push_back(it->path());
  }
  if (error) ThrowError("read " + Quoted(folder), error.value());
  return entries;
}

}  // namespace

bool IsFolder(const fs::path& path) {
  return fs::symlink_status(path).type() == fs::file_type::directory;
}

fs::path CanonicalPath(const fs::path& path) {
  const fs::path canonical = fs::weakly_canonical(fs::absolute(path));
  return canonical.filename().empty() ? canonical.parent_path() : canonical;
}

void FileOperations::Rename(const fs::path& from, const fs::path& to) {
  if (rename(from.c_str(), to.c_str()) != 0) {
    ThrowError("move " + Quoted(from) + " to " + Quoted(to), errno);
  }
}

bool FileOperations::Exchange(const fs::path& a, const fs::path& b) {
#ifdef RENAME_EXCHANGE
  if (renameat2(AT_FDCWD, a.c_str(), AT_FDCWD, b.c_str(), RENAME_EXCHANGE) ==
      0) {
    return true;
  }
  if (errno != EINVAL && errno != ENOSYS && errno != ENOTSUP) {
    ThrowError("swap " + Quoted(a) + " and " + Quoted(b), errno);
  }
#endif
  return false;
}

void FileOperations::Link(const fs::path& from, const fs::path& to) {
  if (link(from.c_str(), to.c_str()) != 0) {
    ThrowError("link " + Quoted(from) + " to " + Quoted(to), errno);
  }
}

void FileOperations::Remove(const fs::path& path) {
  if (std::remove(path.c_str()) != 0 && errno != ENOENT) {
    ThrowError("remove " + Quoted(path), errno);
  }
}

void FileOperations::MakeFolder(const fs::path& path) {
  if (mkdir(path.c_str(), 0777) != 0 && errno != EEXIST) {
    ThrowWriteError(path);
  }
}

void FileOperations::Sync(const fs::path& path) {
  const int fd = open(path.c_str(), O_RDONLY | O_CLOEXEC);
  if (fd < 0) ThrowWriteError(path);
  int result = 0;
  do {
    result = fsync(fd);
  } while (result != 0 && errno == EINTR);
  const int reason = result == 0 ? 0 : errno;
  close(fd);
  if (reason != 0 && !IsSyncUnsupported(reason)) {
    errno = reason;
    ThrowWriteError(path);
  }
}

void ReplaceOneOfMany(const fs::path& path, const std::string& content) {
  std::error_code ignored;
  const fs::file_status earlier = fs::status(path, ignored);
  if (fs::exists(earlier) && !fs::is_regular_file(earlier)) {
    return WriteFile(path, content);
  }
  const fs::path target = CanonicalPath(path);  // a link is not replaced
  // The name is the same in every run, so killed runs leave at most one draft.
  const fs::path draft = target.parent_path() /
                         ("." + target.filename().string() + ".mgsfm-draft");
  FileOperations operations;
  try {
    WriteFile(draft, content);
    if (fs::exists(earlier)) fs::permissions(draft, earlier.permissions());
    operations.Sync(draft);
    operations.Rename(draft, target);
  } catch (...) {
    fs::remove(draft, ignored);
    throw;
  }
}

void ReplaceFile(const fs::path& path, const std::string& content) {
  ReplaceOneOfMany(path, content);
  FileOperations().Sync(CanonicalPath(path).parent_path());
}

bool IsWritten(const fs::path& path) {
  std::error_code ignored;
  return fs::is_regular_file(path, ignored) && fs::file_size(path, ignored) > 0;
}

void RemoveTree(const fs::path& folder, FileOperations* operations) {
  for (const fs::path& entry : EntriesOf(folder)) {
    if (IsFolder(entry)) {
      RemoveTree(entry, operations);
    } else {
      operations->Remove(entry);
    }
  }
  operations->Remove(folder);
}

void SyncTree(const fs::path& folder, FileOperations* operations) {
  for (const fs::path& entry : EntriesOf(folder)) {
    if (IsFolder(entry)) {
      SyncTree(entry, operations);
    } else if (!fs::is_symlink(entry)) {
      operations->Sync(entry);
    }
  }
  operations->Sync(folder);
}

}  // namespace mgsfm

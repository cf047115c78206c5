// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <filesystem>
#include <string>

namespace mgsfm {

// Writes a file, replacing an existing one. Throws Error, naming the file and
// the reason, if it cannot be written completely.
void WriteFile(const std::filesystem::path& path, const std::string& content);

// Throws the Error for a failed write to a file or folder, with the reason in
// errno.
[[noreturn]] void ThrowWriteError(const std::filesystem::path& path);

// The file operations by which a finished output replaces an earlier one. They
// go through this interface, so that a test can make each of them fail or be
// the last. Every operation throws Error with the path and the reason.
class FileOperations {
 public:
  virtual ~FileOperations() = default;

  virtual void Rename(const std::filesystem::path& from,
                      const std::filesystem::path& to);
  // Swaps two entries atomically (renameat2, Linux). Returns false, without
  // changes, if the system or the file system does not support it.
  virtual bool Exchange(const std::filesystem::path& a,
                        const std::filesystem::path& b);
  // Makes another name of a file (a hard link).
  virtual void Link(const std::filesystem::path& from,
                    const std::filesystem::path& to);
  // Removes a file, a link or an empty folder; ignores missing entries.
  virtual void Remove(const std::filesystem::path& path);
  // Makes a folder; an existing folder is unchanged.
  virtual void MakeFolder(const std::filesystem::path& path);
  // Waits until a file, or the entries of a folder, are on the disk (fsync).
  virtual void Sync(const std::filesystem::path& path);
};

// Whether the path is a folder, and not a link to one.
bool IsFolder(const std::filesystem::path& path);

// The absolute path, of the target if it is a link, without a final slash.
std::filesystem::path CanonicalPath(const std::filesystem::path& path);

// Writes a file. An earlier file remains until the new one is complete, unless
// it is not a regular file, such as a pipe. Throws Error on failure.
void ReplaceFile(const std::filesystem::path& path, const std::string& content);

// The same for one of many files that a later run can write again. The content
// is on disk before the file gets its name, because a later run assumes that
// the file is complete; the caller syncs the folders.
void ReplaceOneOfMany(const std::filesystem::path& path,
                      const std::string& content);

// Whether an earlier run wrote this file. A file without content may come from
// a full disk.
bool IsWritten(const std::filesystem::path& path);

// Removes a folder with everything in it, one Remove per entry.
void RemoveTree(const std::filesystem::path& folder,
                FileOperations* operations);

// Syncs all files and folders in a folder, and the folder itself.
void SyncTree(const std::filesystem::path& folder, FileOperations* operations);

}  // namespace mgsfm

// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <filesystem>
#include <string>

namespace mgsfm {

// Writes a file, replacing one of that name. Throws Error, naming the file and
// the reason, if it cannot be written completely.
void WriteFile(const std::filesystem::path& path, const std::string& content);

// Throws the Error for a failed write to a file or folder, with the reason in
// errno.
[[noreturn]] void ThrowWriteError(const std::filesystem::path& path);

// The calls by which a finished output takes the place of an earlier one. All
// of them go through this interface, so that a test can make each one fail or
// be the last. Every call throws Error with the path and the reason.
class FileOperations {
 public:
  virtual ~FileOperations() = default;

  virtual void Rename(const std::filesystem::path& from,
                      const std::filesystem::path& to);
  // Swaps two entries atomically (renameat2, Linux). Returns false, having done
  // nothing, where the system or the file system cannot.
  virtual bool Exchange(const std::filesystem::path& a,
                        const std::filesystem::path& b);
  // Makes another name of a file (a hard link).
  virtual void Link(const std::filesystem::path& from,
                    const std::filesystem::path& to);
  // Removes a file, a link or an empty folder; missing ones are ignored.
  virtual void Remove(const std::filesystem::path& path);
  // Makes a folder; one that exists is left as it is.
  virtual void MakeFolder(const std::filesystem::path& path);
  // Waits until a file, or the entries of a folder, are on the disk (fsync).
  virtual void Sync(const std::filesystem::path& path);
};

// Whether it is a folder, and not a link to one.
bool IsFolder(const std::filesystem::path& path);

// The absolute path, of the target if it is a link, without a final slash.
std::filesystem::path CanonicalPath(const std::filesystem::path& path);

// Writes a file. An earlier one stays as it is until the new one is complete,
// unless it is no regular file, such as a pipe. Throws Error on failure.
void ReplaceFile(const std::filesystem::path& path, const std::string& content);

// The same for one of many files, each of which a later run can write again.
// The content is on the disk before the file gets its name, as a later run
// takes it for complete; names wait for the caller to sync the folders.
void ReplaceOneOfMany(const std::filesystem::path& path,
                      const std::string& content);

// Removes a folder with everything in it, one Remove per entry.
void RemoveTree(const std::filesystem::path& folder,
                FileOperations* operations);

// Syncs all files and folders in a folder, and the folder itself.
void SyncTree(const std::filesystem::path& folder, FileOperations* operations);

}  // namespace mgsfm

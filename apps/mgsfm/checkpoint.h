// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <cstdint>
#include <filesystem>
#include <optional>
#include <string>

#include "io/files/file_operations.h"
#include "io/files/folder_lock.h"
#include "mgsfm/base/context.h"
#include "mgsfm/pipeline/stage_store.h"

namespace mgsfm {

// A folder with a file for each stage of a run. A file appears as a whole or
// not at all; it starts with a version, the hash of what determines the run,
// and the hash of its content. A damaged file is ignored, with a warning.
class Checkpoint : public StageStore {
 public:
  // Makes the folder. Throws Error if another run uses it, if it is not
  // writable, or if it belongs to a run with another hash.
  Checkpoint(const std::filesystem::path& folder, uint64_t hash_of_run,
             const Context& context);

  std::optional<std::string> Load(const std::string& name) override;
  void Save(const std::string& name, const std::string& content) override;

  // Removes all files, and the folder if it is empty then.
  void Remove();

 private:
  std::filesystem::path PathOf(const std::string& name) const;
  void CheckOwner() const;

  std::filesystem::path folder_;
  uint64_t hash_of_run_;
  const Context& context_;
  FileOperations operations_;
  FolderLock lock_;
};

}  // namespace mgsfm

// SPDX-License-Identifier: BSD-3-Clause
#include "io/files/staged_output.h"

#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <string>
#include <system_error>
#include <utility>
#include <vector>

#include "io/files/folder_lock.h"
#include "io/files/output_file.h"
#include "mgsfm/base/error.h"

namespace mgsfm {
namespace {

namespace fs = std::filesystem;

// "0", "1", ...: the names under which models are written.
bool IsModelName(const std::string& name) {
  return !name.empty() && (name == "0" || name[0] != '0') &&
         std::all_of(name.begin(), name.end(),
                     [](char c) { return c >= '0' && c <= '9'; });
}

// Whether a folder is empty or holds a model, so that nothing else is lost
// with it.
bool HoldsModelOrNothing(const fs::path& path) {
  return fs::is_directory(path) &&
         (fs::is_empty(path) || fs::exists(path / "images.bin") ||
          fs::exists(path / "images.txt"));
}

bool IsModelFileName(const fs::path& name) {
  const bool is_model_format =
      name.extension() == ".bin" || name.extension() == ".txt";
  constexpr const char* kStems[] = {"cameras", "images", "points3D", "rigs",
                                    "frames"};
  return is_model_format && std::find(std::begin(kStems), std::end(kStems),
                                      name.stem()) != std::end(kStems);
}

void CheckReplaceable(const fs::path& target) {
  for (const auto& entry : fs::directory_iterator(target)) {
    if (IsModelName(entry.path().filename().string()) &&
        !HoldsModelOrNothing(entry.path())) {
      throw Error("'" + entry.path().string() +
                  "' is no model, and a model would replace it; choose another "
                  "output path");
    }
  }
}

// Within the staging folder: what Commit() put aside.
constexpr char kReplaced[] = ".replaced";

// Staging folders are called like this and six more characters.
std::string StagingPrefix(const fs::path& target) {
  return "." + target.filename().string() + ".mgsfm-";
}

bool IsStagingName(const std::string& name, const std::string& prefix) {
  return name.size() == prefix.size() + 6 &&
         name.compare(0, prefix.size(), prefix) == 0;
}

// Removes a staging folder whose owner was killed.
void RemoveIfStale(const fs::path& staging) {
  const FolderLock lock(staging);
  if (lock.state() != FolderLock::State::kHeld) return;
  std::error_code ignored;  // what cannot be removed does no harm
  const fs::path replaced = staging / kReplaced;
  if (fs::exists(replaced, ignored) && !fs::is_empty(replaced, ignored)) {
    throw Error(
        "an earlier run was killed while it replaced models; see what "
        "is to be kept of those it put aside in '" +
        replaced.string() + "', then remove '" + staging.string() + "'");
  }
  fs::remove_all(staging, ignored);
}

void RemoveStale(const fs::path& folder, const std::string& prefix) {
  std::error_code ignored;  // of a folder that cannot be read
  std::vector<fs::path> found;
  for (const auto& entry : fs::directory_iterator(folder, ignored)) {
    if (IsStagingName(entry.path().filename().string(), prefix)) {
      found.push_back(entry.path());
    }
  }
  for (const fs::path& staging : found) RemoveIfStale(staging);
}

// The moves made so far, undone in reverse order unless all succeeded.
class Moves {
 public:
  ~Moves() {
    if (is_done_) return;
    for (auto it = moves_.rbegin(); it != moves_.rend(); ++it) {
      std::error_code ignored;  // nothing more can be done for this entry
      fs::rename(it->second, it->first, ignored);
    }
  }
  void Move(const fs::path& from, const fs::path& to) {
    std::error_code error;
    fs::rename(from, to, error);
    if (error) {
      throw Error("cannot move '" + from.string() + "' to '" + to.string() +
                  "': " + error.message());
    }
    moves_.emplace_back(from, to);
  }
  void Keep() { is_done_ = true; }

 private:
  std::vector<std::pair<fs::path, fs::path>> moves_;
  bool is_done_ = false;
};

}  // namespace

StagedOutput::StagedOutput(const fs::path& target, ObsoleteOutput obsolete)
    : target_(fs::weakly_canonical(fs::absolute(target))), obsolete_(obsolete) {
  if (target_.filename().empty()) target_ = target_.parent_path();
  const bool is_new = !fs::exists(target_);
  if (!is_new) {
    if (!fs::is_directory(target_)) {
      throw Error("the output path '" + target_.string() + "' is not a folder");
    }
    if (obsolete == ObsoleteOutput::kModels) CheckReplaceable(target_);
  }
  // Within an existing target, which may be a mount point: moving from beside
  // it would cross file systems.
  const fs::path parent = is_new ? target_.parent_path() : target_;
  for (fs::path path = parent; !fs::exists(path); path = path.parent_path()) {
    new_parents_.push_back(path);
  }
  RemoveStale(target_.parent_path(), StagingPrefix(target_));
  if (!is_new) RemoveStale(target_, StagingPrefix(target_));
  try {
    MakeStagingDir(parent);
  } catch (...) {
    RemoveNewParents();
    throw;
  }
}

void StagedOutput::MakeStagingDir(const fs::path& parent) {
  std::error_code error;
  fs::create_directories(parent, error);
  if (error) {
    errno = error.value();
    ThrowWriteError(target_);
  }
  do {
    std::string name = (parent / (StagingPrefix(target_) + "XXXXXX")).string();
    if (mkdtemp(name.data()) == nullptr) ThrowWriteError(target_);
    staging_ = name;
    lock_ = std::make_unique<FolderLock>(staging_);
    // Until it is locked, another run may take it for a stale one.
  } while (lock_->state() == FolderLock::State::kBusy);
  fs::permissions(staging_, fs::perms::owner_all | fs::perms::group_read |
                                fs::perms::group_exec | fs::perms::others_read |
                                fs::perms::others_exec);
}

StagedOutput::~StagedOutput() {
  std::error_code ignored;  // a destructor cannot report it
  fs::remove_all(staging_, ignored);
  RemoveNewParents();
}

void StagedOutput::RemoveNewParents() {
  for (const fs::path& path : new_parents_) {
    std::error_code ignored;
    fs::remove(path, ignored);  // refused where it is not empty
  }
}

bool StagedOutput::IsObsolete(const fs::path& entry) const {
  if (obsolete_ == ObsoleteOutput::kModelFiles) {
    return IsModelFileName(entry.filename()) && fs::is_regular_file(entry);
  }
  return IsModelName(entry.filename().string()) && HoldsModelOrNothing(entry);
}

void StagedOutput::Commit() {
  Moves moves;
  if (!fs::exists(target_)) {
    moves.Move(staging_, target_);
    moves.Keep();
    return;
  }
  const fs::path replaced = staging_ / kReplaced;
  std::error_code error;
  fs::create_directory(replaced, error);
  if (error) {
    errno = error.value();
    ThrowWriteError(replaced);
  }
  std::vector<fs::path> entries, obsolete;
  for (const auto& entry : fs::directory_iterator(staging_)) {
    if (entry.path() != replaced) entries.push_back(entry.path());
  }
  for (const auto& entry : fs::directory_iterator(target_)) {
    const fs::path name = entry.path().filename();
    if (fs::exists(staging_ / name) || IsObsolete(entry.path())) {
      obsolete.push_back(entry.path());
    }
  }
  for (const fs::path& path : obsolete) {
    moves.Move(path, replaced / path.filename());
  }
  for (const fs::path& path : entries) {
    moves.Move(path, target_ / path.filename());
  }
  moves.Keep();
}

}  // namespace mgsfm

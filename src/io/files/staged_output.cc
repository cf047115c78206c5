// SPDX-License-Identifier: BSD-3-Clause
#include "files/staged_output.h"

#include <fcntl.h>
#include <sys/file.h>
#include <sys/stat.h>
#include <unistd.h>

#include <cerrno>
#include <cstring>
#include <system_error>

#include "mgsfm/base/error.h"

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

namespace fs = std::filesystem;

constexpr char kSuffix[] = "XXXXXX";  // mkdtemp replaces it

// Temporary folders are named by this prefix and a random suffix.
std::string StagingPrefix(const fs::path& target) {
  return "." + target.filename().string() + ".mgsfm-";
}

bool IsOnDeviceOf(const fs::path& a, const fs::path& b) {
  struct stat status_a, status_b;
  return stat(a.c_str(), &status_a) == 0 && stat(b.c_str(), &status_b) == 0 &&
         status_a.st_dev == status_b.st_dev;
}

// Tests the entry itself, not the target of a link.
bool Exists(const fs::path& path) {
  return fs::exists(fs::symlink_status(path));
}

// A shell in the working folder would then be in a removed folder.
bool CanMove(const fs::path& folder) {
  std::error_code ignored;
  return IsFolder(folder) && IsOnDeviceOf(folder, folder.parent_path()) &&
         !fs::equivalent(folder, fs::current_path(ignored), ignored);
}

[[noreturn]] void ThrowNotReplaceable(const fs::path& path,
                                      const std::string& problem) {
  throw Error("'" + path.string() + "' " + problem +
              "; choose another output path");
}

std::vector<std::string> NamesIn(const fs::path& folder) {
  const FolderContents contents = ListFolder(folder);
  std::vector<std::string> names = contents.model_files;
  names.insert(names.end(), contents.others.begin(), contents.others.end());
  return names;
}

enum class Way { kLink, kMove };

// Adds entries of a folder to another folder that lacks them.
void AddMissing(const fs::path& from, const fs::path& to,
                const std::vector<std::string>& names, Way way,
                FileOperations* operations) {
  for (const std::string& name : names) {
    const bool is_missing = !Exists(to / name);
    if (IsFolder(from / name) && (is_missing || IsFolder(to / name))) {
      operations->MakeFolder(to / name);
      if (is_missing) {
        fs::permissions(to / name, fs::status(from / name).permissions());
      }
      AddMissing(from / name, to / name, NamesIn(from / name), way, operations);
    } else if (is_missing && way == Way::kLink) {
      operations->Link(from / name, to / name);
    } else if (is_missing) {
      operations->Rename(from / name, to / name);
    }
  }
}

fs::path New(const fs::path& work) { return work / "new"; }
fs::path Old(const fs::path& work) { return work / "old"; }
// The name of work/new after its entries have been exchanged.
fs::path Replaced(const fs::path& work) { return work / "replaced"; }

// Restores entries taken from `base` without a successor, and files that
// another program has written into a folder before it was taken.
void PutBack(const fs::path& work, const fs::path& base,
             FileOperations* operations) {
  for (const fs::path& folder : {Old(work), Replaced(work)}) {
    if (!IsFolder(folder)) continue;
    for (const std::string& name : NamesIn(folder)) {
      const fs::path from = folder / name, to = base / name;
      if (folder == Old(work) && !Exists(to)) {
        operations->Rename(from, to);
      } else if (IsFolder(from) && !ListFolder(from).others.empty()) {
        operations->MakeFolder(to);
        AddMissing(from, to, ListFolder(from).others, Way::kMove, operations);
      }
    }
  }
}

// Ignores failures: the next run removes remaining files.
void RemoveWorkFolder(const fs::path& work, FileOperations* operations) {
  try {
    RemoveTree(work, operations);
  } catch (const std::exception&) {
  }
}

void MakeFolders(const fs::path& folder, const fs::path& target) {
  std::error_code error;
  fs::create_directories(folder, error);
  if (!error) return;
  errno = error.value();
  ThrowWriteError(target);
}

// Two renames would hide the other files for a moment.
void CheckOthers(const fs::path& folder, const fs::path& work,
                 FileOperations* operations) {
  const std::vector<std::string> others = ListFolder(folder).others;
  if (others.empty() || (operations->Exchange(New(work), Old(work)) &&
                         operations->Exchange(New(work), Old(work)))) {
    return;
  }
  ThrowNotReplaceable(folder / others.front(),
                      "is in the folder of a model, which this file system "
                      "cannot replace in one step");
}

// Throws Error unless `entry` may be replaced by a folder, or else by a file.
// Replaced files must belong to a model: cameras.txt may be some other list of
// cameras.
void CheckReplaceable(const fs::path& entry, bool by_folder) {
  if (fs::is_directory(entry) != by_folder) {
    if (!by_folder) {
      ThrowNotReplaceable(entry, "is a folder, and a file would replace it");
    }
    ThrowNotReplaceable(entry, "is a file, and a folder would replace it");
  }
  if (!by_folder) return;
  if (!CanMove(entry)) {
    ThrowNotReplaceable(entry,
                        "is a link, a mount point or the working folder, and a "
                        "model would replace it");
  }
  const FolderContents contents = ListFolder(entry);
  for (const std::string& name : contents.others) {
    if (IsModelFileName(name)) {
      ThrowNotReplaceable(entry / name, "is a folder, not a file of a model");
    }
  }
  if (contents.HoldsModel() || contents.model_files.empty()) return;
  ThrowNotReplaceable(entry / contents.model_files.front(),
                      "is not part of a model (there is no images.bin or "
                      "images.txt), and the output might replace it");
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

StagedOutput::StagedOutput(const fs::path& target, OutputKind kind,
                           FileOperations* operations)
    : operations_(operations != nullptr ? operations : &default_operations_),
      target_(CanonicalPath(target)),
      kind_(kind) {
  RemoveStale(target_.parent_path());
  const bool is_new = !fs::exists(target_);
  if (!is_new && !fs::is_directory(target_)) {
    throw Error("the output path '" + target_.string() + "' is not a folder");
  }
  const bool is_base = !is_new && kind == OutputKind::kRun;
  if (is_base) RemoveStale(target_);
  base_ = is_base ? target_ : target_.parent_path();
  for (fs::path path = base_; !fs::exists(path); path = path.parent_path()) {
    new_parents_.push_back(path);
  }
  try {
    MakeWorkFolder();
    if (!is_new) CheckTarget();
  } catch (...) {
    RemoveFolders();
    throw;
  }
}

// Removes temporary folders of killed processes.
void StagedOutput::RemoveStale(const fs::path& folder) const {
  std::error_code error;  // an unreadable folder has no temporary folders
  const fs::directory_iterator entries(folder, error);
  for (const fs::path& work : std::vector<fs::path>(entries, {})) {
    const std::string name = work.filename().string();
    const std::string prefix = StagingPrefix(target_);
    if (name.size() != prefix.size() + std::strlen(kSuffix) ||
        name.compare(0, prefix.size(), prefix) != 0 || !IsFolder(work)) {
      continue;
    }
    const FolderLock lock(work);
    // A file system without locks does not show whether the owner is alive.
    if (lock.state() != FolderLock::State::kHeld) continue;
    const FolderLock folder_lock(folder, FolderLock::Wait::kYes);
    PutBack(work, folder, operations_);
    RemoveWorkFolder(work, operations_);
  }
}

void StagedOutput::MakeWorkFolder() {
  MakeFolders(base_, target_);
  do {
    std::string path = base_ / (StagingPrefix(target_) + kSuffix);
    if (mkdtemp(path.data()) == nullptr) ThrowWriteError(target_);
    work_ = path;
    lock_ = std::make_unique<FolderLock>(work_);
    // Until the folder is locked, another run may treat it as stale.
  } while (lock_->state() == FolderLock::State::kBusy);
  MakeFolders(StagingDir(), target_);
  MakeFolders(Old(work_), target_);
}

fs::path StagedOutput::StagingDir() const {
  const fs::path new_dir = New(work_);
  return base_ == target_ ? new_dir : new_dir / target_.filename();
}

void StagedOutput::CheckTarget() {
  const auto check_model = [&](const fs::path& folder) {
    CheckReplaceable(folder, true);
    if (ListFolder(folder).HoldsModel()) {
      CheckOthers(folder, work_, operations_);
    }
  };
  if (kind_ == OutputKind::kModel) return check_model(target_);
  for (const std::string& name : ListFolder(target_).others) {
    if (name == kReportFileName) CheckReplaceable(target_ / name, false);
    if (IsModelFolderName(name)) check_model(target_ / name);
  }
}

void StagedOutput::PrepareEntry(const std::string& name) {
  const fs::path staged = New(work_) / name, target = base_ / name;
  if (!Exists(target)) return;
  const bool is_folder = fs::is_directory(staged);
  CheckReplaceable(target, is_folder);
  if (!is_folder) return;
  CheckOthers(target, work_, operations_);
  fs::permissions(staged, fs::status(target).permissions());
  AddMissing(target, staged, ListFolder(target).others, Way::kLink,
             operations_);
}

void StagedOutput::PrepareObsoleteModels() {
  if (base_ != target_) return;
  for (const std::string& name : ListFolder(target_).others) {
    if (!IsModelFolderName(name) || Exists(New(work_) / name)) continue;
    const FolderContents contents = ListFolder(target_ / name);
    if (!contents.IsEmpty() && !contents.HoldsModel()) continue;
    if (contents.others.empty()) {
      obsolete_.push_back(name);
    } else {
      operations_->MakeFolder(New(work_) / name);
      PrepareEntry(name);
    }
  }
}

void StagedOutput::Move(const fs::path& from, const fs::path& to) {
  operations_->Rename(from, to);
  undo_.emplace_back([this, from, to] { operations_->Rename(to, from); });
}

void StagedOutput::Place(const std::string& name) {
  const fs::path staged = New(work_) / name, target = base_ / name;
  if (!Exists(target)) return Move(staged, target);
  if (operations_->Exchange(staged, target)) {
    undo_.emplace_back([=] { operations_->Exchange(staged, target); });
    return;
  }
  Move(target, Old(work_) / name);
  Move(staged, target);
}

void StagedOutput::PlaceAll() {
  const std::vector<std::string> names = NamesIn(New(work_));
  try {
    for (const std::string& name : names) Place(name);
    for (const std::string& name : obsolete_) {
      Move(base_ / name, New(work_) / name);
    }
    for (const fs::path& folder : {base_, New(work_), Old(work_)}) {
      operations_->Sync(folder);
    }
  } catch (...) {
    is_tidy_ = false;
    while (!undo_.empty()) {
      undo_.back()();
      undo_.pop_back();
    }
    is_tidy_ = true;
    throw;
  }
}

void StagedOutput::Commit() {
  const FolderLock lock(base_, FolderLock::Wait::kYes);
  for (const std::string& name : NamesIn(New(work_))) PrepareEntry(name);
  PrepareObsoleteModels();
  SyncTree(New(work_), operations_);
  PlaceAll();
  is_tidy_ = false;
  try {
    operations_->Rename(New(work_), Replaced(work_));
    PutBack(work_, base_, operations_);
    is_tidy_ = true;
  } catch (const Error&) {
    // The output is complete; the next run cleans up.
  }
}

StagedOutput::~StagedOutput() { RemoveFolders(); }

void StagedOutput::RemoveFolders() const {
  if (is_tidy_ && !work_.empty()) RemoveWorkFolder(work_, operations_);
  for (const fs::path& path : new_parents_) {
    std::error_code ignored;
    fs::remove(path, ignored);  // refused where it is not empty
  }
}

}  // namespace mgsfm

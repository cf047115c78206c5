// SPDX-License-Identifier: BSD-3-Clause
#include "files/staged_output.h"

#include <sys/stat.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <string>
#include <system_error>

#include "files/folder_lock.h"
#include "files/model_files.h"
#include "files/output_file.h"
#include "mgsfm/base/error.h"

namespace mgsfm {
namespace {

namespace fs = std::filesystem;

constexpr char kSuffix[] = "XXXXXX";  // mkdtemp replaces it

// Names of temporary folders are this prefix and a random suffix.
std::string StagingPrefix(const fs::path& target) {
  return "." + target.filename().string() + ".mgsfm-";
}

bool IsStagingName(const std::string& name, const std::string& prefix) {
  return name.size() == prefix.size() + sizeof(kSuffix) - 1 &&
         name.compare(0, prefix.size(), prefix) == 0;
}

bool IsOnDeviceOf(const fs::path& a, const fs::path& b) {
  struct stat status_a, status_b;
  return stat(a.c_str(), &status_a) == 0 && stat(b.c_str(), &status_b) == 0 &&
         status_a.st_dev == status_b.st_dev;
}

// The entry itself, not what a link points to.
bool Exists(const fs::path& path) {
  return fs::exists(fs::symlink_status(path));
}

bool IsRealFolder(const fs::path& path) {
  return fs::symlink_status(path).type() == fs::file_type::directory;
}

// A shell that is in the working folder would be in a removed one.
bool CanMove(const fs::path& folder) {
  std::error_code ignored;
  return IsRealFolder(folder) && IsOnDeviceOf(folder, folder.parent_path()) &&
         !fs::equivalent(folder, fs::current_path(ignored), ignored);
}

fs::path Canonical(const fs::path& path) {
  const fs::path canonical = fs::weakly_canonical(fs::absolute(path));
  return canonical.filename().empty() ? canonical.parent_path() : canonical;
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

// Makes links to entries of a folder in another one that lacks them.
void LinkMissing(const fs::path& from, const fs::path& to,
                 const std::vector<std::string>& names,
                 FileOperations* operations) {
  for (const std::string& name : names) {
    if (IsRealFolder(from / name)) {
      operations->MakeFolder(to / name);
      fs::permissions(to / name, fs::status(from / name).permissions());
      LinkMissing(from / name, to / name, NamesIn(from / name), operations);
    } else if (!Exists(to / name)) {
      operations->Link(from / name, to / name);
    }
  }
}

// Another program may have written into a folder before it was taken away.
void MoveMissing(const fs::path& from, const fs::path& to,
                 const std::vector<std::string>& names,
                 FileOperations* operations) {
  for (const std::string& name : names) {
    if (!Exists(to / name)) {
      operations->Rename(from / name, to / name);
    } else if (IsRealFolder(from / name) && IsRealFolder(to / name)) {
      MoveMissing(from / name, to / name, NamesIn(from / name), operations);
    }
  }
}

// Another program may have written into a folder before it was taken away.
void MoveOthersBack(const fs::path& from, const fs::path& to,
                    FileOperations* operations) {
  if (!IsRealFolder(from)) return;
  const std::vector<std::string> others = ListFolder(from).others;
  if (others.empty()) return;
  operations->MakeFolder(to);
  MoveMissing(from, to, others, operations);
}

fs::path New(const fs::path& work) { return work / "new"; }
fs::path Old(const fs::path& work) { return work / "old"; }
// The name of work/new when its entries have been exchanged.
fs::path Replaced(const fs::path& work) { return work / "replaced"; }

// Puts back what was taken away from `base` without a successor.
void PutBack(const fs::path& work, const fs::path& base,
             FileOperations* operations) {
  for (const fs::path& folder : {Old(work), Replaced(work)}) {
    if (!IsRealFolder(folder)) continue;
    for (const std::string& name : NamesIn(folder)) {
      if (folder == Old(work) && !Exists(base / name)) {
        operations->Rename(folder / name, base / name);
      } else {
        MoveOthersBack(folder / name, base / name, operations);
      }
    }
  }
}

}  // namespace

StagedOutput::StagedOutput(const fs::path& target, OutputKind kind)
    : StagedOutput(target, kind, &default_operations_) {}

StagedOutput::StagedOutput(const fs::path& target, OutputKind kind,
                           FileOperations* operations)
    : operations_(operations), target_(Canonical(target)), kind_(kind) {
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

// Removes temporary folders whose owners were killed.
void StagedOutput::RemoveStale(const fs::path& folder) const {
  std::vector<fs::path> found;
  std::error_code error;  // an unreadable folder has no temporary folders
  for (fs::directory_iterator it(folder, error), end; !error && it != end;
       it.increment(error)) {
    const std::string name = it->path().filename().string();
    if (IsStagingName(name, StagingPrefix(target_)) && IsRealFolder(*it)) {
      found.push_back(it->path());
    }
  }
  for (const fs::path& work : found) {
    const FolderLock lock(work);
    // A file system without locks does not show whether the owner is alive.
    if (lock.state() != FolderLock::State::kHeld) continue;
    const FolderLock folder_lock(folder, FolderLock::Wait::kYes);
    PutBack(work, folder, operations_);
    try {
      RemoveTree(work, operations_);
    } catch (const std::exception&) {
      // The rest has no meaning, and a later run tries again.
    }
  }
}

void StagedOutput::MakeWorkFolder() {
  MakeFolders(base_);
  do {
    std::string path = base_ / (StagingPrefix(target_) + kSuffix);
    if (mkdtemp(path.data()) == nullptr) ThrowWriteError(target_);
    work_ = path;
    lock_ = std::make_unique<FolderLock>(work_);
    // Another run may take the folder for a stale one until it is locked.
  } while (lock_->state() == FolderLock::State::kBusy);
  MakeFolders(StagingDir());
  MakeFolders(Old(work_));
}

void StagedOutput::MakeFolders(const fs::path& folder) const {
  std::error_code error;
  fs::create_directories(folder, error);
  if (!error) return;
  errno = error.value();
  ThrowWriteError(target_);
}

fs::path StagedOutput::StagingDir() const {
  const fs::path new_dir = New(work_);
  return base_ == target_ ? new_dir : new_dir / target_.filename();
}

void StagedOutput::CheckTarget() {
  if (kind_ == OutputKind::kModel) return CheckReplaceable(target_);
  for (const std::string& name : ListFolder(target_).others) {
    const fs::path path = target_ / name;
    if (name == kReportFileName && IsRealFolder(path)) {
      ThrowNotReplaceable(path, "is a folder, and a report would replace it");
    }
    if (!IsModelFolderName(name)) continue;
    if (!fs::is_directory(path)) {
      ThrowNotReplaceable(path, "is a file, and a model would replace it");
    }
    CheckReplaceable(path);
  }
}

// Files that would be replaced must belong to a model: cameras.txt may be some
// other list of cameras.
void StagedOutput::CheckReplaceable(const fs::path& folder) {
  if (!CanMove(folder)) {
    ThrowNotReplaceable(folder,
                        "is a link, a mount point or the working folder, and a "
                        "model would replace it");
  }
  const FolderContents contents = ListFolder(folder);
  for (const std::string& name : contents.others) {
    if (IsModelFileName(name)) {
      ThrowNotReplaceable(folder / name, "is a folder, not a file of a model");
    }
  }
  if (contents.HoldsModel()) return CheckOthers(folder);
  if (contents.model_files.empty()) return;
  ThrowNotReplaceable(folder / contents.model_files.front(),
                      "is not part of a model (there is no images.bin or "
                      "images.txt), and the output might replace it");
}

// Two renames would hide the other files in between.
void StagedOutput::CheckOthers(const fs::path& folder) {
  const std::vector<std::string> others = ListFolder(folder).others;
  if (others.empty()) return;
  const bool can_exchange = operations_->Exchange(New(work_), Old(work_)) &&
                            operations_->Exchange(New(work_), Old(work_));
  if (can_exchange) return;
  ThrowNotReplaceable(folder / others.front(),
                      "is in the folder of a model, which this file system "
                      "cannot replace in one step");
}

void StagedOutput::PrepareEntry(const std::string& name) {
  const fs::path staged = New(work_) / name, target = base_ / name;
  if (!Exists(target)) return;
  if (!fs::is_directory(staged)) {
    if (!IsRealFolder(target)) return;
    ThrowNotReplaceable(target, "is a folder, and a file would replace it");
  }
  if (!fs::is_directory(target)) {
    ThrowNotReplaceable(target, "is a file, and a folder would replace it");
  }
  CheckReplaceable(target);
  CheckOthers(target);
  fs::permissions(staged, fs::status(target).permissions());
  LinkMissing(target, staged, ListFolder(target).others, operations_);
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
    // The output is complete; the next run tidies up.
  }
}

StagedOutput::~StagedOutput() { RemoveFolders(); }

void StagedOutput::RemoveFolders() const {
  try {
    if (is_tidy_ && !work_.empty()) RemoveTree(work_, operations_);
  } catch (const std::exception&) {
    // A destructor cannot report it; the next run removes the folder.
  }
  for (const fs::path& path : new_parents_) {
    std::error_code ignored;
    fs::remove(path, ignored);  // refused where it is not empty
  }
}

bool IsReplacedByOutput(const fs::path& target, OutputKind kind,
                        const fs::path& file) {
  const fs::path folder = Canonical(target);
  const fs::path path = Canonical(file);
  const fs::path parent = path.parent_path();
  if (path.filename() == kReportFileName) return parent == folder;
  if (!IsModelFileName(path.filename())) return false;
  return kind == OutputKind::kModel ? parent == folder
                                    : parent.parent_path() == folder &&
                                          IsModelFolderName(parent.filename());
}

}  // namespace mgsfm

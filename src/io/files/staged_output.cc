// SPDX-License-Identifier: BSD-3-Clause
#include "io/files/staged_output.h"

#include <sys/stat.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <random>
#include <string>
#include <system_error>

#include "io/files/folder_lock.h"
#include "io/files/model_files.h"
#include "io/files/output_file.h"
#include "io/files/output_swap.h"
#include "mgsfm/base/error.h"

namespace mgsfm {
namespace {

namespace fs = std::filesystem;

constexpr size_t kSuffixLength = 6;  // 36^6 names; one in use is drawn again

// Names of temporary folders are this prefix and a random suffix.
std::string StagingPrefix(const fs::path& target) {
  return "." + target.filename().string() + ".mgsfm-";
}

bool IsStagingName(const std::string& name, const std::string& prefix) {
  return name.size() == prefix.size() + kSuffixLength &&
         name.compare(0, prefix.size(), prefix) == 0;
}

std::string RandomSuffix() {
  constexpr char kLetters[] = "abcdefghijklmnopqrstuvwxyz0123456789";
  std::random_device random;
  std::string suffix;
  for (size_t i = 0; i < kSuffixLength; ++i) {
    suffix += kLetters[random() % (sizeof(kLetters) - 1)];
  }
  return suffix;
}

bool IsOnDeviceOf(const fs::path& a, const fs::path& b) {
  struct stat status_a, status_b;
  return stat(a.c_str(), &status_a) == 0 && stat(b.c_str(), &status_b) == 0 &&
         status_a.st_dev == status_b.st_dev;
}

bool IsRealFolder(const fs::path& path) {
  return fs::symlink_status(path).type() == fs::file_type::directory;
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

// Files that would be replaced must belong to a model: cameras.txt may be some
// other list of cameras.
void CheckModelFolder(const fs::path& folder) {
  const FolderContents contents = ListFolder(folder);
  for (const std::string& name : contents.others) {
    if (IsModelFileName(name)) {
      ThrowNotReplaceable(folder / name, "is a folder, not a file of a model");
    }
  }
  if (contents.model_files.empty() || contents.HoldsModel()) return;
  ThrowNotReplaceable(folder / contents.model_files.front(),
                      "is not part of a model (there is no images.bin or "
                      "images.txt), and the output might replace it");
}

void CheckRunFolder(const fs::path& folder) {
  for (const std::string& name : ListFolder(folder).others) {
    const fs::path path = folder / name;
    if (name == kReportFileName && IsRealFolder(path)) {
      ThrowNotReplaceable(path, "is a folder, and a report would replace it");
    }
    if (!IsModelFolderName(name)) continue;
    if (!fs::is_directory(path)) {
      ThrowNotReplaceable(path, "is a file, and a model would replace it");
    }
    if (!IsOnDeviceOf(path, folder)) {
      ThrowNotReplaceable(path, "is not on the file system of its parent");
    }
    CheckModelFolder(path);
  }
}

// A report is replaced only by a report.
bool HoldsOnlyModelAndReport(const FolderContents& contents) {
  return std::all_of(
      contents.others.begin(), contents.others.end(),
      [](const std::string& name) { return name == kReportFileName; });
}

// The file of images comes first: without it there is no model.
std::vector<std::string> ImagesFirst(std::vector<std::string> names) {
  std::stable_partition(names.begin(), names.end(), IsImagesFileName);
  return names;
}

}  // namespace

StagedOutput::StagedOutput(const fs::path& target, OutputKind kind)
    : StagedOutput(target, kind, &default_operations_) {}

StagedOutput::StagedOutput(const fs::path& target, OutputKind kind,
                           FileOperations* operations)
    : operations_(operations), target_(Canonical(target)), kind_(kind) {
  RemoveStale(target_.parent_path());
  const bool is_new = !fs::exists(target_);
  if (!is_new) {
    if (!fs::is_directory(target_)) {
      throw Error("the output path '" + target_.string() + "' is not a folder");
    }
    RemoveStale(target_);
    kind == OutputKind::kRun ? CheckRunFolder(target_)
                             : CheckModelFolder(target_);
  }
  base_ = ChooseBase();
  for (fs::path path = base_; !fs::exists(path); path = path.parent_path()) {
    new_parents_.push_back(path);
  }
  try {
    MakeStagingDir();
  } catch (...) {
    RemoveNewParents();
    throw;
  }
}

// A new target is made beside its temporary folder. An existing one may be a
// mount point, so the temporary folder lies within it, unless it is a model
// that can be exchanged as a whole.
fs::path StagedOutput::ChooseBase() const {
  const fs::path parent = target_.parent_path();
  if (!fs::exists(target_)) return parent;
  const bool is_exchanged = kind_ == OutputKind::kModel && CanMove(target_) &&
                            access(parent.c_str(), W_OK) == 0 &&
                            HoldsOnlyModelAndReport(ListFolder(target_));
  return is_exchanged ? parent : target_;
}

// The working folder stays: a shell that is in it would be in a removed one.
bool StagedOutput::CanMove(const fs::path& folder) const {
  std::error_code ignored;
  return IsRealFolder(folder) && IsOnDeviceOf(folder, folder.parent_path()) &&
         !fs::equivalent(folder, fs::current_path(ignored), ignored);
}

// Removes temporary folders whose owners were killed, after finishing their
// swaps.
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
  for (const fs::path& staging : found) {
    const FolderLock lock(staging);
    if (lock.state() == FolderLock::State::kBusy) continue;
    if (OutputSwap::IsPending(staging)) {
      const FolderLock folder_lock(folder, FolderLock::Wait::kYes);
      OutputSwap::FinishPending(folder, staging, operations_);
    }
    // A file system without locks does not show whether the owner is alive.
    if (lock.state() != FolderLock::State::kHeld) continue;
    try {
      RemoveTree(staging, operations_);
    } catch (const std::exception&) {
      // The rest has no meaning, and a later run tries again.
    }
  }
}

void StagedOutput::MakeStagingDir() {
  std::error_code error;
  fs::create_directories(base_, error);
  if (error) {
    errno = error.value();
    ThrowWriteError(target_);
  }
  do {
    staging_ = base_ / (StagingPrefix(target_) + RandomSuffix());
    if (mkdir(staging_.c_str(), 0777) != 0) {
      if (errno == EEXIST) continue;
      ThrowWriteError(target_);
    }
    lock_ = std::make_unique<FolderLock>(staging_);
    // Another run may take the folder for a stale one until it is locked.
  } while (lock_ == nullptr || lock_->state() == FolderLock::State::kBusy);
  fs::create_directories(StagingDir(), error);
  if (error) {
    errno = error.value();
    ThrowWriteError(target_);
  }
}

fs::path StagedOutput::StagingDir() const {
  const fs::path new_dir = OutputSwap::NewDir(staging_);
  return base_ == target_ ? new_dir : new_dir / target_.filename();
}

StagedOutput::~StagedOutput() {
  try {
    if (!OutputSwap::IsPending(staging_)) RemoveTree(staging_, operations_);
  } catch (const std::exception&) {
    // A destructor cannot report it; the next run removes the folder.
  }
  RemoveNewParents();
}

void StagedOutput::RemoveNewParents() {
  for (const fs::path& path : new_parents_) {
    std::error_code ignored;
    fs::remove(path, ignored);  // refused where it is not empty
  }
}

// The name, relative to base_, of an entry of the target.
std::string StagedOutput::InBase(const std::string& name) const {
  return base_ == target_ ? name : (target_.filename() / name).string();
}

void StagedOutput::PlanEntry(const std::string& name, OutputSwap* swap) const {
  const fs::path staged = swap->NewDir() / name;
  const fs::path target = base_ / name;
  if (!fs::exists(fs::symlink_status(target))) {
    swap->Add(name);
    return;
  }
  if (!fs::is_directory(staged)) {
    if (IsRealFolder(target)) {
      ThrowNotReplaceable(target, "is a folder, and a file would replace it");
    }
    swap->Replace(name);
    return;
  }
  if (!fs::is_directory(target)) {
    ThrowNotReplaceable(target, "is a file, and a folder would replace it");
  }
  const FolderContents contents = ListFolder(staged);
  if (contents.HoldsModel()) {
    PlanModel(name, swap);
    return;
  }
  for (const auto& names : {contents.model_files, contents.others}) {
    for (const std::string& child : names) {
      PlanEntry((fs::path(name) / child).string(), swap);
    }
  }
}

void StagedOutput::PlanModel(const std::string& name, OutputSwap* swap) const {
  const fs::path folder = base_ / name;
  CheckModelFolder(folder);
  const FolderContents earlier = ListFolder(folder);
  const FolderContents staged = ListFolder(swap->NewDir() / name);
  const auto is_staged = [&](const std::string& file) {
    return fs::exists(swap->NewDir() / name / file);
  };
  const bool is_replaced_as_a_whole =
      !name.empty() && HoldsOnlyModelAndReport(earlier) && CanMove(folder) &&
      std::all_of(earlier.others.begin(), earlier.others.end(), is_staged);
  if (is_replaced_as_a_whole) {
    fs::permissions(swap->NewDir() / name, fs::status(folder).permissions());
    swap->Replace(name);
    return;
  }
  for (const std::string& file : ImagesFirst(earlier.model_files)) {
    if (IsImagesFileName(file) || !is_staged(file)) {
      swap->Remove((fs::path(name) / file).string());
    }
  }
  std::vector<std::string> images_last = ImagesFirst(staged.model_files);
  std::reverse(images_last.begin(), images_last.end());
  for (const auto& names : {staged.others, images_last}) {
    for (const std::string& file : names)
      PlanEntry((fs::path(name) / file).string(), swap);
  }
}

void StagedOutput::PlanRemoval(const std::string& name,
                               OutputSwap* swap) const {
  const fs::path folder = base_ / name;
  const FolderContents contents = ListFolder(folder);
  if (contents.others.empty() && CanMove(folder)) {
    swap->Remove(name);
    return;
  }
  for (const std::string& file : ImagesFirst(contents.model_files)) {
    swap->Remove((fs::path(name) / file).string());
  }
}

void StagedOutput::PlanObsoleteModels(OutputSwap* swap) const {
  if (kind_ != OutputKind::kRun || !fs::exists(target_)) return;
  for (const std::string& name : ListFolder(target_).others) {
    if (!IsModelFolderName(name) || fs::exists(StagingDir() / name)) continue;
    const FolderContents contents = ListFolder(target_ / name);
    if (contents.IsEmpty() || contents.HoldsModel()) {
      PlanRemoval(InBase(name), swap);
    }
  }
}

void StagedOutput::Commit() {
  OutputSwap swap(base_, staging_, operations_);
  SyncTree(swap.NewDir(), operations_);
  const FolderLock lock(base_, FolderLock::Wait::kYes);
  if (base_ != target_) {
    PlanEntry(target_.filename().string(), &swap);
  } else if (kind_ == OutputKind::kModel) {
    PlanModel("", &swap);
  } else {
    PlanEntry("", &swap);
  }
  PlanObsoleteModels(&swap);
  swap.Run();
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

// SPDX-License-Identifier: BSD-3-Clause
#include "io/files/output_swap.h"

#include <sys/stat.h>

#include <locale>
#include <optional>
#include <set>
#include <sstream>
#include <utility>

#include "base/file_reading.h"
#include "io/files/model_files.h"
#include "mgsfm/base/error.h"

namespace mgsfm {
namespace {

namespace fs = std::filesystem;

constexpr char kJournal[] = "journal";
constexpr char kDraft[] = "journal.draft";

// The entry itself, not what a link points to.
bool Exists(const fs::path& path) {
  return fs::exists(fs::symlink_status(path));
}

bool IsFolder(const fs::path& path) {
  return fs::symlink_status(path).type() == fs::file_type::directory;
}

std::optional<uint64_t> InodeOf(const fs::path& path) {
  struct stat status;
  if (lstat(path.c_str(), &status) != 0) return std::nullopt;
  return status.st_ino;
}

// Names may hold any character but NUL, so NUL ends a record.
std::string ToText(const std::vector<SwapStep>& steps) {
  std::string text;
  for (const SwapStep& step : steps) {
    text += std::to_string(static_cast<int>(step.kind)) + ' ' +
            std::to_string(step.inode) + ' ' + step.name + '\0';
  }
  return text;
}

std::vector<SwapStep> ParseSteps(std::istream& text) {
  std::vector<SwapStep> steps;
  for (std::string record; std::getline(text, record, '\0');) {
    std::istringstream fields(record);
    fields.imbue(std::locale::classic());
    int kind = 0;
    SwapStep step;
    fields >> kind >> step.inode;
    fields.get();
    std::getline(fields, step.name, '\0');
    step.kind = static_cast<SwapStep::Kind>(kind);
    steps.push_back(std::move(step));
  }
  return steps;
}

}  // namespace

OutputSwap::OutputSwap(fs::path base, fs::path work, FileOperations* operations)
    : base_(std::move(base)), work_(std::move(work)), operations_(operations) {}

fs::path OutputSwap::Target(const std::string& name) const {
  return base_ / name;
}
fs::path OutputSwap::NewDir(const fs::path& work) { return work / "new"; }
fs::path OutputSwap::New(const std::string& name) const {
  return NewDir() / name;
}
fs::path OutputSwap::Old(const std::string& name) const {
  return work_ / "old" / name;
}

void OutputSwap::AddStep(SwapStep::Kind kind, const std::string& name) {
  const std::optional<uint64_t> inode = InodeOf(New(name));
  MGSFM_CHECK_MSG(inode.has_value(), name);
  steps_.push_back({kind, name, *inode});
}

void OutputSwap::Add(const std::string& name) {
  AddStep(SwapStep::Kind::kAdd, name);
}

void OutputSwap::Replace(const std::string& name) {
  AddStep(SwapStep::Kind::kReplace, name);
}

void OutputSwap::Remove(const std::string& name) {
  steps_.push_back({SwapStep::Kind::kRemove, name, 0});
}

bool OutputSwap::IsPending(const fs::path& work) {
  return Exists(work / kJournal);
}

void OutputSwap::Publish() {
  operations_->MakeFolder(work_ / "old");
  operations_->Write(work_ / kDraft, ToText(steps_));
  operations_->Sync(work_ / kDraft);
  operations_->Rename(work_ / kDraft, work_ / kJournal);
  operations_->Sync(work_);
}

void OutputSwap::Load() {
  std::istringstream file(ReadFile(work_ / kJournal));
  steps_ = ParseSteps(file);
}

// Once the journal is gone, the rest of `work` means nothing.
void OutputSwap::Retract() {
  operations_->Remove(work_ / kJournal);
  operations_->Sync(work_);
}

bool OutputSwap::IsStillNew(const SwapStep& step) const {
  return InodeOf(New(step.name)) == step.inode;
}

void OutputSwap::TakeAway(const std::string& name) {
  fs::path folder = work_ / "old";
  for (const fs::path& part : fs::path(name).parent_path()) {
    operations_->MakeFolder(folder /= part);
  }
  operations_->Rename(Target(name), Old(name));
}

void OutputSwap::Do(const SwapStep& step) {
  const fs::path target = Target(step.name);
  if (step.kind == SwapStep::Kind::kRemove) {
    if (!Exists(Old(step.name)) && Exists(target)) TakeAway(step.name);
    return;
  }
  if (!IsStillNew(step)) return;  // done before
  if (Exists(target)) {
    if (step.kind == SwapStep::Kind::kAdd) {
      throw Error("'" + target.string() +
                  "' was made by another program during the run; move it away");
    }
    if (operations_->Exchange(New(step.name), target)) return;
    TakeAway(step.name);
  }
  operations_->Rename(New(step.name), target);
}

void OutputSwap::Undo(const SwapStep& step) {
  const fs::path target = Target(step.name);
  const bool is_done =
      step.kind != SwapStep::Kind::kRemove && InodeOf(target) == step.inode;
  if (is_done && Exists(New(step.name))) {  // the old one, after an exchange
    if (!operations_->Exchange(New(step.name), target)) {
      throw Error("cannot swap '" + target.string() + "' back");
    }
  } else if (is_done) {
    operations_->Rename(target, New(step.name));
  }
  if (Exists(Old(step.name)) && !Exists(target)) {
    operations_->Rename(Old(step.name), target);
  }
}

// Another program may have written into a folder before it was taken away.
void OutputSwap::MoveBackOthers(const fs::path& from, const fs::path& to) {
  if (!IsFolder(from)) return;
  for (const std::string& name : ListFolder(from).others) {
    operations_->MakeFolder(to);
    if (!Exists(to / name)) operations_->Rename(from / name, to / name);
  }
}

void OutputSwap::MoveBackOthers() {
  for (const SwapStep& step : steps_) {
    if (step.kind == SwapStep::Kind::kAdd) continue;
    MoveBackOthers(New(step.name), Target(step.name));
    MoveBackOthers(Old(step.name), Target(step.name));
  }
}

void OutputSwap::SyncFolders() {
  std::set<fs::path> folders;
  for (const SwapStep& step : steps_) {
    folders.insert(Target(step.name).parent_path());
    folders.insert(New(step.name).parent_path());
    folders.insert(Old(step.name).parent_path());
  }
  for (const fs::path& folder : folders) {
    if (Exists(folder)) operations_->Sync(folder);
  }
}

void OutputSwap::DoAll() {
  for (const SwapStep& step : steps_) Do(step);
  MoveBackOthers();
  SyncFolders();
}

void OutputSwap::UndoAll() {
  for (auto step = steps_.rbegin(); step != steps_.rend(); ++step) Undo(*step);
  MoveBackOthers();
  SyncFolders();
}

void OutputSwap::Run() {
  try {
    Publish();
    DoAll();
  } catch (...) {
    UndoAll();
    Retract();
    throw;
  }
  try {
    Retract();
  } catch (const Error&) {
    // The output is complete; the next run removes the journal.
  }
}

void OutputSwap::FinishPending(const fs::path& base, const fs::path& work,
                               FileOperations* operations) {
  OutputSwap swap(base, work, operations);
  swap.Load();
  try {
    swap.DoAll();
  } catch (...) {
    try {
      swap.UndoAll();
    } catch (const Error& error) {
      throw Error("a killed run left a swap in '" + work.string() +
                  "' that can neither be finished nor undone: " + error.what() +
                  "; make the folder writable and run again");
    }
  }
  swap.Retract();
}

}  // namespace mgsfm

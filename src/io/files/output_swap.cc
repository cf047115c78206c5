// SPDX-License-Identifier: BSD-3-Clause
#include "io/files/output_swap.h"

#include <sys/stat.h>

#include <optional>
#include <set>
#include <utility>

#include "base/file_reading.h"
#include "base/text_streams.h"
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
    TextInput fields(record);
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

using Steps = std::vector<SwapStep>;

fs::path Target(const SwapPlaces& places, const std::string& name) {
  return places.base / name;
}
fs::path New(const SwapPlaces& places, const std::string& name) {
  return OutputSwap::NewDir(places.work) / name;
}
fs::path Old(const SwapPlaces& places, const std::string& name) {
  return places.work / "old" / name;
}

void Publish(const SwapPlaces& places, const Steps& steps,
             FileOperations* operations) {
  operations->MakeFolder(places.work / "old");
  operations->Write(places.work / kDraft, ToText(steps));
  operations->Sync(places.work / kDraft);
  operations->Rename(places.work / kDraft, places.work / kJournal);
  operations->Sync(places.work);
}

// Once the journal is gone, the rest of `work` means nothing.
void Retract(const SwapPlaces& places, FileOperations* operations) {
  operations->Remove(places.work / kJournal);
  operations->Sync(places.work);
}

void TakeAway(const SwapPlaces& places, const std::string& name,
              FileOperations* operations) {
  fs::path folder = places.work / "old";
  for (const fs::path& part : fs::path(name).parent_path()) {
    operations->MakeFolder(folder /= part);
  }
  operations->Rename(Target(places, name), Old(places, name));
}

void Do(const SwapPlaces& places, const SwapStep& step,
        FileOperations* operations) {
  const fs::path target = Target(places, step.name);
  if (step.kind == SwapStep::Kind::kRemove) {
    if (!Exists(Old(places, step.name)) && Exists(target))
      TakeAway(places, step.name, operations);
    return;
  }
  if (InodeOf(New(places, step.name)) != step.inode) return;  // done before
  if (Exists(target)) {
    if (step.kind == SwapStep::Kind::kAdd) {
      throw Error("'" + target.string() +
                  "' was made by another program during the run; move it away");
    }
    if (operations->Exchange(New(places, step.name), target)) return;
    TakeAway(places, step.name, operations);
  }
  operations->Rename(New(places, step.name), target);
}

void Undo(const SwapPlaces& places, const SwapStep& step,
          FileOperations* operations) {
  const fs::path target = Target(places, step.name);
  const bool is_done =
      step.kind != SwapStep::Kind::kRemove && InodeOf(target) == step.inode;
  if (is_done &&
      Exists(New(places, step.name))) {  // the old one, after an exchange
    if (!operations->Exchange(New(places, step.name), target)) {
      throw Error("cannot swap '" + target.string() + "' back");
    }
  } else if (is_done) {
    operations->Rename(target, New(places, step.name));
  }
  if (Exists(Old(places, step.name)) && !Exists(target)) {
    operations->Rename(Old(places, step.name), target);
  }
}

// Another program may have written into a folder before it was taken away.
void MoveBackOthers(const fs::path& from, const fs::path& to,
                    FileOperations* operations) {
  if (!IsFolder(from)) return;
  for (const std::string& name : ListFolder(from).others) {
    operations->MakeFolder(to);
    if (!Exists(to / name)) operations->Rename(from / name, to / name);
  }
}

void MoveBackOthers(const SwapPlaces& places, const Steps& steps,
                    FileOperations* operations) {
  for (const SwapStep& step : steps) {
    if (step.kind == SwapStep::Kind::kAdd) continue;
    MoveBackOthers(New(places, step.name), Target(places, step.name),
                   operations);
    MoveBackOthers(Old(places, step.name), Target(places, step.name),
                   operations);
  }
}

void SyncFolders(const SwapPlaces& places, const Steps& steps,
                 FileOperations* operations) {
  std::set<fs::path> folders;
  for (const SwapStep& step : steps) {
    folders.insert(Target(places, step.name).parent_path());
    folders.insert(New(places, step.name).parent_path());
    folders.insert(Old(places, step.name).parent_path());
  }
  for (const fs::path& folder : folders) {
    if (Exists(folder)) operations->Sync(folder);
  }
}

void DoAll(const SwapPlaces& places, const Steps& steps,
           FileOperations* operations) {
  for (const SwapStep& step : steps) Do(places, step, operations);
  MoveBackOthers(places, steps, operations);
  SyncFolders(places, steps, operations);
}

void UndoAll(const SwapPlaces& places, const Steps& steps,
             FileOperations* operations) {
  for (auto step = steps.rbegin(); step != steps.rend(); ++step)
    Undo(places, *step, operations);
  MoveBackOthers(places, steps, operations);
  SyncFolders(places, steps, operations);
}

}  // namespace

OutputSwap::OutputSwap(fs::path base, fs::path work, FileOperations* operations)
    : places_{std::move(base), std::move(work)}, operations_(operations) {}

fs::path OutputSwap::NewDir(const fs::path& work) { return work / "new"; }
void OutputSwap::AddStep(SwapStep::Kind kind, const std::string& name) {
  const std::optional<uint64_t> inode = InodeOf(New(places_, name));
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

void OutputSwap::Run() {
  try {
    Publish(places_, steps_, operations_);
    DoAll(places_, steps_, operations_);
  } catch (...) {
    UndoAll(places_, steps_, operations_);
    Retract(places_, operations_);
    throw;
  }
  try {
    Retract(places_, operations_);
  } catch (const Error&) {
    // The output is complete; the next run removes the journal.
  }
}

void OutputSwap::FinishPending(const fs::path& base, const fs::path& work,
                               FileOperations* operations) {
  const SwapPlaces places{base, work};
  TextInput journal(ReadFile(work / kJournal));
  const Steps steps = ParseSteps(journal);
  try {
    DoAll(places, steps, operations);
  } catch (...) {
    try {
      UndoAll(places, steps, operations);
    } catch (const Error& error) {
      throw Error("a killed run left a swap in '" + work.string() +
                  "' that can neither be finished nor undone: " + error.what() +
                  "; make the folder writable and run again");
    }
  }
  Retract(places, operations);
}

}  // namespace mgsfm

// SPDX-License-Identifier: BSD-3-Clause
#include "faults/fault_sweep.h"

#include <sqlite3.h>

#include <memory>

#include "faults/visible_files.h"
#include "frontend/features/blob_images.h"

namespace mgsfm {
namespace {

namespace fs = std::filesystem;

struct FaultKind {
  Fault fault;
  int error = 0;
  PowerLoss loss = PowerLoss::kAll;
  CountedCalls counted = CountedCalls::kChanges;
};

constexpr FaultKind kFaultKinds[] = {
    {Fault::kError, EIO},
    {Fault::kError, EINTR},
    {Fault::kError, ENOMEM},
    {Fault::kErrorAlways, ENOSPC},
    {Fault::kErrorAlways, EROFS},
    {Fault::kShort},
    {Fault::kKill},
    {Fault::kPowerLoss},
    {Fault::kPowerLoss, 0, PowerLoss::kContent},
    {Fault::kPowerLoss, 0, PowerLoss::kSomeContent},
    {Fault::kError, EIO, PowerLoss::kAll, CountedCalls::kChangesAndReads},
    {Fault::kShort, 0, PowerLoss::kAll, CountedCalls::kChangesAndReads},
    {Fault::kError, EAGAIN, PowerLoss::kAll, CountedCalls::kLocks}};

void ExpectSuccessOrMessage(const CommandOutput& output) {
  EXPECT_TRUE(output.exit_code == 0 || output.exit_code == 1)
      << output.exit_code;
  EXPECT_EQ(output.exit_code == 0, LastWord(output).empty());
}

// A command that leaves out images that it cannot read may have too few.
bool MayHaveNoModel(const FaultCase& command, const CommandOutput& output) {
  return output.exit_code == 2 && !command.images_database.empty() &&
         KindOfFaultyCall() == CallKind::kRead;
}

}  // namespace

void ExecuteSql(const fs::path& path, const std::string& sql) {
  sqlite3* opened = nullptr;
  sqlite3_open(path.c_str(), &opened);
  const std::unique_ptr<sqlite3, int (*)(sqlite3*)> db(opened, sqlite3_close);
  ASSERT_EQ(sqlite3_exec(opened, sql.c_str(), nullptr, nullptr, nullptr),
            SQLITE_OK);
}

void WriteImage(const fs::path& path, uint64_t seed) {
  constexpr int kWidth = 80, kHeight = 60;
  fs::create_directories(path.parent_path());
  const GrayImage image =
      RenderBlobs(RandomBlobs(40, kWidth, kHeight, seed), kWidth, kHeight);
  std::string text = "P5 80 60 255\n";
  text.append(reinterpret_cast<const char*>(image.data()),
              static_cast<size_t>(image.size()));
  WriteTextFile(path, text);
}

CommandOutput FaultTest::Run(const std::string& arguments,
                             const fs::path& folder, const FaultPlan& plan) {
  const TempDir dir;
  const std::string out_path = (dir.path() / "out").string();
  const std::string err_path = (dir.path() / "err").string();
  std::vector<std::string> words;
  std::istringstream text(arguments);
  for (std::string word; text >> word;) words.push_back(word);
  std::cout.flush();
  const pid_t pid = fork();
  MGSFM_CHECK(pid >= 0);
  if (pid == 0) {
    alarm(60);
    fs::current_path(folder);
    if (!plan.folder.empty()) StartFaults(plan);
    BecomeMgsfm(words, out_path, err_path);
  }
  int status = 0;
  MGSFM_CHECK(waitpid(pid, &status, 0) == pid);
  return {ExitCodeOf(status), ReadTextFile(out_path), ReadTextFile(err_path)};
}

// Checks the output that a faulty run has left. `is_whole`: it is either old or
// new.
void FaultTest::CheckState(const FaultCase& command, bool is_whole) {
  const Files now = VisibleFiles(Sandbox());
  // Files that the command does not write stay.
  for (const auto& [name, content] : old_) {
    const auto after = new_.find(name);
    if (after == new_.end() || after->second != content) continue;
    const auto found = now.find(name);
    ASSERT_TRUE(found != now.end()) << name << " is lost";
    EXPECT_TRUE(found->second == content) << name << " has changed";
  }
  for (const auto& [name, content] : now) {
    EXPECT_NE(content, kDamaged) << name;
    const bool is_stage = !command.stages_folder.empty() &&
                          name.rfind(command.stages_folder, 0) == 0;
    EXPECT_TRUE(is_stage || old_.count(name) + new_.count(name) > 0)
        << name << " is new";
    if (!command.is_atomic) continue;
    const auto before = old_.find(name), after = new_.find(name);
    EXPECT_TRUE((before != old_.end() && before->second == content) ||
                (after != new_.end() && after->second == content))
        << name << " is neither old nor new";
  }
  if (command.is_atomic && is_whole) {
    EXPECT_TRUE(now == old_ || now == new_) << "between old and new";
  }
}

void FaultTest::RunWithFault(const FaultCase& command, const FaultPlan& plan) {
  SCOPED_TRACE(command.name + ", fault " +
               std::to_string(static_cast<int>(plan.fault)) + ", error " +
               std::to_string(plan.error) + ", loss " +
               std::to_string(static_cast<int>(plan.loss)) + ", call " +
               std::to_string(plan.call));
  Restore();
  const CommandOutput output = Run(command.arguments, Sandbox(), plan);
  SCOPED_TRACE("kind of call " +
               std::to_string(static_cast<int>(KindOfFaultyCall())) + ": " +
               output.err);
  // The number of transactions of a run depends on its speed.
  if (NumCalls() <= plan.call) return;
  ++num_faults_;
  const bool has_ended =
      plan.fault != Fault::kKill && plan.fault != Fault::kPowerLoss;
  const bool may_have_no_model = MayHaveNoModel(command, output);
  if (!has_ended) {
    EXPECT_EQ(output.exit_code, kKilledExitCode);
  } else if (!may_have_no_model) {
    ExpectSuccessOrMessage(output);
  }
  // Nothing can be undone on a disk that stays read-only.
  const bool can_undo = plan.fault != Fault::kErrorAlways ||
                        KindOfFaultyCall() != CallKind::kName;
  CheckState(command, has_ended && can_undo);
  bool may_lack_images = may_have_no_model;
  if (has_ended && output.exit_code == 0) {
    const bool is_complete = VisibleFiles(Sandbox()) == new_;
    // An image that cannot be read is left out with a warning; the next run
    // adds it.
    may_lack_images = KindOfFaultyCall() == CallKind::kRead &&
                      !command.is_atomic &&
                      output.err.find("warning") != std::string::npos;
    EXPECT_TRUE(is_complete || may_lack_images) << "success, not complete";
    if (is_complete && !HasHiddenFiles(Sandbox())) return;
    // Only the removal of old files can fail without consequence.
    EXPECT_TRUE(!is_complete || KindOfFaultyCall() == CallKind::kName ||
                KindOfFaultyCall() == CallKind::kRead);
  }
  const CommandOutput next = Run(command.arguments, Sandbox(), {});
  // An adjustment in place may start from its own result, which the next run
  // completes.
  if (may_lack_images && !command.images_database.empty()) {
    EXPECT_EQ(FeaturesByName(Sandbox() / command.images_database),
              new_features_)
        << "the next run: " << next.err;
  } else if (!command.is_in_place) {
    EXPECT_EQ(Differences(VisibleFiles(Sandbox()), new_), "")
        << "the next run: " << next.err;
  }
  // A command that makes something new may find it complete.
  const bool is_there =
      next.err.find("exists; choose") != std::string::npos ||
      next.err.find("exists already; choose") != std::string::npos;
  EXPECT_EQ(next.exit_code, is_there ? 1 : 0) << next.err;
  EXPECT_TRUE(is_there || !HasHiddenFiles(Sandbox()));
}

void FaultTest::Sweep(const FaultCase& command) {
  Restore();
  old_ = VisibleFiles(Sandbox());
  const CommandOutput clean = Run(command.arguments, Sandbox(), {});
  ASSERT_EQ(clean.exit_code, 0) << clean.err;
  new_ = VisibleFiles(Sandbox());
  if (!command.images_database.empty())
    new_features_ = FeaturesByName(Sandbox() / command.images_database);
  ASSERT_TRUE(old_ != new_);
  for (const FaultKind& kind : kFaultKinds) {
    FaultPlan plan;
    plan.folder = Sandbox().string();
    plan.counted = kind.counted;
    Restore();
    ASSERT_EQ(Run(command.arguments, Sandbox(), plan).exit_code, 0);
    const long num_calls = NumCalls();
    if (num_calls == 0) {
      // Commands on models lock no database.
      ASSERT_TRUE(kind.counted == CountedCalls::kLocks);
      continue;
    }
    plan.fault = kind.fault;
    plan.error = kind.error;
    plan.loss = kind.loss;
    const long stride =
        stride_.value_or(std::max(1L, num_calls / command.max_runs));
    // Different kinds of faults meet different calls.
    for (long call = (&kind - kFaultKinds) % stride; call < num_calls;
         call += stride) {
      plan.call = call;
      RunWithFault(command, plan);
      if (HasFailure()) return;
    }
  }
  std::cout << command.name << ": " << num_faults_ << " faults" << std::endl;
}

}  // namespace mgsfm

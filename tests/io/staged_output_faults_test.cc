// SPDX-License-Identifier: BSD-3-Clause
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <map>
#include <string>
#include <vector>

#include "io/staged_output_fixtures.h"

namespace mgsfm {
namespace {

namespace fs = std::filesystem;
using testing::HasSubstr;

// Operations of which one may fail, or be the last.
class FaultyOperations : public FileOperations {
 public:
  enum class Fault { kNone, kFailsOnce, kFailsFromThen };

  FaultyOperations(Fault fault, int call, bool can_exchange)
      : fault_(fault), call_(call), can_exchange_(can_exchange) {}

  void Rename(const fs::path& from, const fs::path& to) override {
    Call("rename " + to.string());
    FileOperations::Rename(from, to);
  }
  bool Exchange(const fs::path& a, const fs::path& b) override {
    if (!can_exchange_) return false;
    Call("exchange " + b.string());
    return FileOperations::Exchange(a, b);
  }
  void Link(const fs::path& from, const fs::path& to) override {
    Call("link " + to.string());
    FileOperations::Link(from, to);
  }
  void Remove(const fs::path& path) override {
    Call("remove " + path.string());
    FileOperations::Remove(path);
  }
  void MakeFolder(const fs::path& path) override {
    Call("make " + path.string());
    FileOperations::MakeFolder(path);
  }
  // Does not sync: thousands of runs would wait for the disk.
  void Sync(const fs::path& path) override { Call("sync " + path.string()); }

  const std::vector<std::string>& log() const { return log_; }

 private:
  void Call(const std::string& what) {
    const int call = static_cast<int>(log_.size());
    log_.push_back(what);
    if (fault_ == Fault::kFailsOnce && call == call_) throw Error("fault");
    if (fault_ == Fault::kFailsFromThen && call >= call_) throw Error("fault");
  }

  const Fault fault_;
  const int call_;
  const bool can_exchange_;
  std::vector<std::string> log_;
};

// Each way to replace an output: the earlier one, and what a run writes.
struct Replacement {
  std::string name;
  OutputKind kind;
  Files before;  // in the target
  Files staged;
  Files after;
};

bool IsUser(const std::string& text) { return text == "mine"; }

// Whether files of the user are in the folder of a model that is replaced.
bool HasOthers(const Replacement& r) {
  return r.name.find("other files") != std::string::npos;
}

std::vector<Replacement> Replacements() {
  const Files new_model = {{"images.bin", "new"}, {"points3D.bin", "new"}};
  const Files new_run = {{"0/images.bin", "new"},
                         {"0/points3D.bin", "new"},
                         {"report.json", "new"}};
  return {
      {"new run", OutputKind::kRun, {}, new_run, new_run},
      {"new model", OutputKind::kModel, {}, new_model, new_model},
      {"run",
       OutputKind::kRun,
       {{"0/images.bin", "old"},
        {"0/covariances.csv", "old"},
        {"1/images.txt", "old"},
        {"2", ""},
        {"report.json", "old"},
        {"notes.txt", "mine"}},
       new_run,
       {{"0/images.bin", "new"},
        {"0/points3D.bin", "new"},
        {"report.json", "new"},
        {"notes.txt", "mine"}}},
      {"run among other files",
       OutputKind::kRun,
       {{"0/images.txt", "old"},
        {"0/points3D.bin", "old"},
        {"0/rig_config.json", "old"},
        {"0/database.db", "mine"},
        {"0/photos/a.jpg", "mine"},
        {"3/images.bin", "old"},
        {"3/notes.txt", "mine"},
        {"report.json", "old"}},
       new_run,
       {{"0/images.bin", "new"},
        {"0/points3D.bin", "new"},
        {"0/database.db", "mine"},
        {"0/photos/a.jpg", "mine"},
        {"3/notes.txt", "mine"},
        {"report.json", "new"}}},
      {"model",
       OutputKind::kModel,
       {{"images.txt", "old"}, {"points3D.txt", "old"}},
       new_model,
       new_model},
      {"model among other files",
       OutputKind::kModel,
       {{"images.bin", "old"}, {"cameras.txt", "old"}, {"a.ply", "mine"}},
       new_model,
       {{"images.bin", "new"}, {"points3D.bin", "new"}, {"a.ply", "mine"}}}};
}

void PutAll(const fs::path& folder, const Files& files) {
  for (const auto& [name, text] : files) {
    if (text.empty()) {
      fs::create_directories(folder / name);
    } else {
      fs::create_directories((folder / name).parent_path());
      WriteTextFile(folder / name, text);
    }
  }
}

// Files of the target itself; what is hidden lies in temporary folders.
Files VisibleFilesIn(const fs::path& folder) {
  Files files;
  for (const auto& [name, text] :
       fs::exists(folder) ? FilesIn(folder) : Files()) {
    if (name.find(".mgsfm-") == std::string::npos) files[name] = text;
  }
  return files;
}

class StagedOutputFault : public testing::TestWithParam<bool> {
 protected:
  using Fault = FaultyOperations::Fault;

  // Without exchange, files of the user are not moved, but refused.
  std::vector<Replacement> Accepted() const {
    std::vector<Replacement> accepted;
    for (const Replacement& r : Replacements()) {
      if (GetParam() || !HasOthers(r)) accepted.push_back(r);
    }
    return accepted;
  }
  // Returns the operations that the replacement took.
  std::vector<std::string> Replace(const Replacement& r, const fs::path& target,
                                   FaultyOperations* operations) const {
    try {
      StagedOutput output(target, r.kind, operations);
      PutAll(output.StagingDir(), r.staged);
      output.Commit();
    } catch (const Error&) {
    }
    return operations->log();
  }
  int CountCalls(const Replacement& r) const {
    const TempDir dir;
    PutAll(dir.path() / "out", r.before);
    FaultyOperations operations(Fault::kNone, 0, GetParam());
    const int num_calls =
        static_cast<int>(Replace(r, dir.path() / "out", &operations).size());
    EXPECT_EQ(FilesIn(dir.path() / "out"), r.after) << r.name;
    return num_calls;
  }
  static void ExpectUserFiles(const Replacement& r, const Files& found) {
    for (const auto& [name, text] : r.before) {
      if (IsUser(text)) {
        EXPECT_EQ(found.count(name), 1u) << r.name << name;
      }
    }
  }
};

// A disk that fails once, as with EBUSY, leaves the old or the new output.
TEST_P(StagedOutputFault, AFailedCallLeavesTheOldOrTheNewOutput) {
  for (const Replacement& r : Accepted()) {
    const int num_calls = CountCalls(r);
    for (int call = 0; call < num_calls; ++call) {
      const TempDir dir;
      PutAll(dir.path() / "out", r.before);
      FaultyOperations operations(Fault::kFailsOnce, call, GetParam());
      Replace(r, dir.path() / "out", &operations);
      const Files found = VisibleFilesIn(dir.path() / "out");
      EXPECT_TRUE(found == r.before || found == r.after)
          << r.name << ", call " << call << ": " << operations.log()[call];
      FaultyOperations sound(Fault::kNone, 0, GetParam());
      Replace(r, dir.path() / "out", &sound);
      EXPECT_EQ(FilesIn(dir.path()).size(), r.after.size()) << r.name << call;
      EXPECT_EQ(FilesIn(dir.path() / "out"), r.after) << r.name << call;
    }
  }
}

// Expects every model to be complete, in its state before or after.
void ExpectWholeModels(const Replacement& r, const Files& found) {
  std::map<std::string, Files> before, after, models;
  const auto sort = [](const Files& files, std::map<std::string, Files>* by) {
    for (const auto& [name, text] : files) {
      if (IsUser(text) || text.empty()) continue;
      (*by)[fs::path(name).parent_path().string()][name] = text;
    }
  };
  sort(r.before, &before);
  sort(r.after, &after);
  sort(found, &models);
  for (const auto& [folder, files] : models) {
    if (folder.empty() && r.kind == OutputKind::kRun) continue;
    EXPECT_TRUE(files == before[folder] || files == after[folder])
        << r.name << " " << folder;
  }
}

// Expects a model in the place of every earlier one that has a successor.
void ExpectNoModelIsMissing(const Replacement& r, const Files& found) {
  for (const auto& file : r.before) {
    if (file.second != "old" || file.first == "report.json") continue;
    const std::string folder = fs::path(file.first).parent_path().string();
    const auto is_in_folder = [&](const Files::value_type& other) {
      return !IsUser(other.second) &&
             fs::path(other.first).parent_path().string() == folder;
    };
    if (!std::any_of(r.after.begin(), r.after.end(), is_in_folder)) continue;
    EXPECT_TRUE(std::any_of(found.begin(), found.end(), is_in_folder))
        << r.name << " " << folder;
  }
}

// Nothing that comes after the kill is done, cleaning up included.
TEST_P(StagedOutputFault, AKillIsPutRightByTheNextRun) {
  int num_kills = 0;
  for (const Replacement& r : Accepted()) {
    const int num_calls = CountCalls(r);
    for (int call = 0; call < num_calls; ++call, ++num_kills) {
      SCOPED_TRACE(r.name + ", killed at call " + std::to_string(call));
      const TempDir dir;
      const fs::path target = dir.path() / "out";
      PutAll(target, r.before);
      FaultyOperations killed(Fault::kFailsFromThen, call, GetParam());
      Replace(r, target, &killed);
      const Files found = VisibleFilesIn(target);
      ExpectUserFiles(r, found);
      ExpectWholeModels(r, found);
      if (GetParam()) ExpectNoModelIsMissing(r, found);

      // A run that writes nothing puts back what has no successor.
      { const StagedOutput next(target, r.kind); }
      const Files repaired = VisibleFilesIn(target);
      ExpectWholeModels(r, repaired);
      ExpectNoModelIsMissing(r, repaired);
      const bool is_one_entry =
          r.kind == OutputKind::kModel || r.before.empty();
      EXPECT_TRUE(!is_one_entry || repaired == r.before || repaired == r.after);
      FaultyOperations sound(Fault::kNone, 0, GetParam());
      Replace(r, target, &sound);
      EXPECT_EQ(FilesIn(target), r.after);
      EXPECT_EQ(std::distance(fs::directory_iterator(dir.path()), {}), 1);
    }
  }
  EXPECT_GT(num_kills, 50);
}

// The run that puts it right may be killed, too.
TEST_P(StagedOutputFault, TwoKillsArePutRightByTheThirdRun) {
  const Replacement r = Replacements()[GetParam() ? 3 : 2];
  const int num_calls = CountCalls(r);
  for (int first = 0; first < num_calls; first += 2) {
    for (int second = 0; second < num_calls; second += 5) {
      const TempDir dir;
      const fs::path target = dir.path() / "out";
      PutAll(target, r.before);
      for (const int call : {first, second}) {
        FaultyOperations killed(Fault::kFailsFromThen, call, GetParam());
        Replace(r, target, &killed);
        ExpectUserFiles(r, VisibleFilesIn(target));
      }
      FaultyOperations sound(Fault::kNone, 0, GetParam());
      Replace(r, target, &sound);
      ASSERT_EQ(FilesIn(target), r.after) << first << " " << second;
      ASSERT_EQ(std::distance(fs::directory_iterator(dir.path()), {}), 1);
    }
  }
}

INSTANTIATE_TEST_SUITE_P(WithAndWithoutExchange, StagedOutputFault,
                         testing::Bool());

TEST_F(StagedOutputTest, OtherFilesAreNotHiddenWhereFoldersCannotBeExchanged) {
  for (const Replacement& r : Replacements()) {
    if (!HasOthers(r)) continue;
    PutAll(target_, r.before);
    FaultyOperations operations(FaultyOperations::Fault::kNone, 0, false);
    EXPECT_THAT(
        ErrorOf([&] { StagedOutput output(target_, r.kind, &operations); }),
        HasSubstr(target_.string()));
    EXPECT_EQ(FilesIn(dir_.path() / "out"), r.before);
    fs::remove_all(target_);
  }
}

// A loss of power must not reorder these: files, links, exchange, clean-up.
TEST_F(StagedOutputTest, EverythingIsOnTheDiskBeforeItIsReliedOn) {
  Put(target_ / "0" / "images.bin", "old");
  Put(target_ / "0" / "notes.txt", "mine");
  FaultyOperations operations(FaultyOperations::Fault::kNone, 0, true);
  fs::path staging;
  {
    StagedOutput output(target_, OutputKind::kRun, &operations);
    staging = output.StagingDir().parent_path();
    Put(output.StagingDir() / "0" / "images.bin", "new");
    output.Commit();
  }
  const std::vector<std::string>& log = operations.log();
  const auto position = [&](const std::string& what) {
    const auto found = std::find(log.begin(), log.end(), what);
    EXPECT_NE(found, log.end()) << what;
    return found - log.begin();
  };
  const std::string work = staging.string();
  const std::string target = target_.string();
  const std::vector<std::string> order = {
      "link " + work + "/new/0/notes.txt",
      "sync " + work + "/new/0/images.bin",
      "sync " + work + "/new/0",
      "sync " + work + "/new",
      "exchange " + target + "/0",
      "sync " + target,
      "rename " + work + "/replaced",
      "remove " + work + "/replaced/0/images.bin"};
  for (size_t i = 1; i < order.size(); ++i) {
    EXPECT_LT(position(order[i - 1]), position(order[i])) << order[i];
  }
}

// Between the plan and the swap, or between a kill and the next run.
TEST_F(StagedOutputTest, FilesThatOthersAddDuringTheSwapStay) {
  for (const bool can_exchange : {false, true}) {
    for (size_t call = 0, num_calls = 1; call < num_calls; ++call) {
      Put(target_ / "0" / "images.bin", "old");
      Put(target_ / "1" / "images.bin", "old");
      FaultyOperations killed(FaultyOperations::Fault::kFailsFromThen,
                              static_cast<int>(call), can_exchange);
      try {
        StagedOutput output(target_, OutputKind::kRun, &killed);
        Put(output.StagingDir() / "0" / "images.bin", "new");
        Put(output.StagingDir() / "report.json", "new");
        output.Commit();
      } catch (const Error&) {
      }
      num_calls = killed.log().size();
      Put(target_ / "0" / "photo.jpg", "mine");
      Put(target_ / "1" / "photo.jpg", "mine");
      WriteNewModel(target_);
      EXPECT_EQ(FilesIn(target_), (Files{{"0/images.bin", "new"},
                                         {"0/photo.jpg", "mine"},
                                         {"1/photo.jpg", "mine"},
                                         {"report.json", "new"}}))
          << call;
      fs::remove_all(target_);
    }
  }
}

}  // namespace
}  // namespace mgsfm

// SPDX-License-Identifier: BSD-3-Clause
#include <cstdlib>
#include <optional>

#include "cli/program_runs.h"
#include "faults/system_calls.h"
#include "faults/visible_files.h"
#include "features/blob_images.h"
#include "mgsfm/io/models/model_io.h"
#include "support/temp_dir.h"

namespace mgsfm {
namespace {

// ------------------------------------------------------------------ commands

constexpr int kManyRuns = 6;

struct FaultCase {
  std::string name;
  std::string arguments;  // in the folder in which it runs
  // What is written is complete at every instant, or not there. Otherwise the
  // next run continues with what is there.
  bool is_atomic = true;
  bool is_in_place = false;  // the output is the input
  int max_runs = kManyRuns;  // per kind of fault
  bool adds_images = false;  // leaves out those that it cannot read
};

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

// Runs of small commands in which one system call goes wrong. The environment
// variable MGSFM_FAULT_STRIDE selects every n-th call (default: some).
class FaultTest : public testing::Test {
 protected:
  FaultTest() {
    const char* stride = std::getenv("MGSFM_FAULT_STRIDE");
    if (stride != nullptr) stride_ = std::atoi(stride);
  }

  fs::path Before() const { return dir_.path() / "before"; }
  fs::path Sandbox() const { return dir_.path() / "run"; }

  // A line of a command for the folder `before`, run without faults.
  void Prepare(const std::string& arguments) const {
    const CommandOutput output = Run(arguments, Before(), {});
    ASSERT_EQ(output.exit_code, 0) << arguments << "\n" << output.err;
  }
  void PrepareImages() const {
    for (int i = 0; i < 3; ++i) {
      const std::string name = std::to_string(i) + ".pgm";
      WriteImage(Before() / "images" / "left" / name, 2 * i);
      WriteImage(Before() / "images" / "right" / name, 2 * i + 1);
    }
  }
  void PrepareDrive() const {
    fs::create_directories(Before());
    Prepare(
        "simulate --output_path sim --num_frames 4 --num_points_per_frame 60");
  }

  // Runs the program in a folder.
  static CommandOutput Run(const std::string& arguments, const fs::path& folder,
                           const FaultPlan& plan);

  // Sweeps over the calls of the command and all kinds of faults.
  void Sweep(const FaultCase& command);

 private:
  void Restore() const {
    fs::remove_all(Sandbox());
    fs::copy(Before(), Sandbox(), fs::copy_options::recursive);
  }
  void RunWithFault(const FaultCase& command, const FaultPlan& plan);
  void CheckState(const FaultCase& command, bool is_whole);

  const TempDir dir_;
  std::optional<long> stride_;  // otherwise that of FaultCase::max_runs
  Files old_, new_;
  std::string new_features_;  // by FeaturesByName
  int num_faults_ = 0;
};

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

// Checks what a faulty run has left. `is_whole`: not between old and new.
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
    EXPECT_TRUE(old_.count(name) + new_.count(name) > 0) << name << " is new";
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
  if (has_ended) {
    EXPECT_TRUE(output.exit_code == 0 || output.exit_code == 1)
        << output.exit_code;
    EXPECT_EQ(output.exit_code == 0, LastWord(output).empty());
  } else {
    EXPECT_EQ(output.exit_code, kKilledExitCode);
  }
  // Nothing can be undone on a disk that stays read-only.
  const bool can_undo = plan.fault != Fault::kErrorAlways ||
                        KindOfFaultyCall() != CallKind::kName;
  CheckState(command, has_ended && can_undo);
  bool may_lack_images = false;
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
  if (may_lack_images && command.adds_images) {
    EXPECT_EQ(FeaturesByName(Sandbox() / "a.db"), new_features_)
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
  if (command.adds_images) new_features_ = FeaturesByName(Sandbox() / "a.db");
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

TEST_F(FaultTest, Simulate) {
  fs::create_directories(Before() / "out");
  WriteTextFile(Before() / "out" / "notes.txt", "mine");
  Sweep(
      {"simulate",
       "simulate --output_path out --num_frames 3 --num_points_per_frame 30"});
}

TEST_F(FaultTest, Extract) {
  PrepareImages();
  WriteTextFile(Before() / "notes.txt", "mine");
  Sweep({"feature_extractor",
         "feature_extractor --database_path a.db --image_path images "
         "--SiftExtraction.max_num_features 30 --num_threads 1",
         false, false, kManyRuns, true});
}

TEST_F(FaultTest, ConfigureRigs) {
  PrepareImages();
  Prepare(
      "feature_extractor --database_path a.db --image_path images "
      "--SiftExtraction.max_num_features 30");
  Sweep({"rig_configurator", "rig_configurator --database_path a.db"});
}

TEST_F(FaultTest, Match) {
  PrepareImages();
  Prepare(
      "feature_extractor --database_path a.db --image_path images "
      "--SiftExtraction.max_num_features 60");
  Sweep({"exhaustive_matcher",
         "exhaustive_matcher --database_path a.db --num_threads 1", false});
}

// Over an earlier model, beside files of the user.
TEST_F(FaultTest, Map) {
  PrepareDrive();
  Prepare(
      "mapper --database_path sim/database.db --output_path out "
      "--write_report 0 "
      "--output_format txt");
  WriteTextFile(Before() / "out" / "0" / "notes.txt", "mine");
  WriteTextFile(Before() / "out" / "photo.jpg", "mine");
  Sweep({"mapper",
         "mapper --database_path sim/database.db --output_path out "
         "--write_report 0 "
         "--num_threads 1"});
}

// A model in a folder of its own is replaced by one exchange.
TEST_F(FaultTest, AdjustInPlace) {
  PrepareDrive();
  Prepare(
      "mapper --database_path sim/database.db --output_path out "
      "--write_report 0");
  Sweep({"bundle_adjuster",
         "bundle_adjuster --input_path out/0 --output_path out/0 "
         "--output_format txt --num_threads 1",
         true, true});
}

TEST_F(FaultTest, Evaluate) {
  PrepareDrive();
  Prepare(
      "mapper --database_path sim/database.db --output_path out "
      "--write_report 0");
  Prepare(
      "model_evaluator --input_path out/0 --gt_path sim/truth --json e.json");
  WriteTextFile(Before() / "e.json", "old");
  Sweep(
      {"model_evaluator",
       "model_evaluator --input_path out/0 --gt_path sim/truth --json e.json"});
}

// ---------------------------------------------- further commands on databases

// Their steps are those of the commands above; scripts/faults.sh sweeps over
// all calls.
constexpr int kFewRuns = 1;

TEST_F(FaultTest, MatchInSequence) {
  PrepareImages();
  Prepare(
      "feature_extractor --database_path a.db --image_path images "
      "--SiftExtraction.max_num_features 60");
  Sweep({"sequential_matcher",
         "sequential_matcher --database_path a.db --num_threads 1", false,
         false, kFewRuns});
}

TEST_F(FaultTest, ImportMatches) {
  PrepareImages();
  Prepare(
      "feature_extractor --database_path a.db --image_path images "
      "--SiftExtraction.max_num_features 60");
  WriteTextFile(Before() / "list.txt",
                "left/0.pgm left/1.pgm\n0 0\n1 1\n2 2\n\n");
  Sweep({"matches_importer",
         "matches_importer --database_path a.db --match_list_path list.txt "
         "--match_type raw --num_threads 1",
         false, false, kFewRuns});
}

TEST_F(FaultTest, Verify) {
  PrepareDrive();
  fs::rename(Before() / "sim" / "database.db", Before() / "a.db");
  ExecuteSql(Before() / "a.db", "DELETE FROM two_view_geometries");
  Sweep({"geometric_verifier",
         "geometric_verifier --database_path a.db --num_threads 1", false,
         false, kFewRuns});
}

TEST_F(FaultTest, CleanDatabase) {
  PrepareDrive();
  Sweep({"database_cleaner",
         "database_cleaner --database_path sim/database.db --type matches",
         true, false, 2});
}

TEST_F(FaultTest, MergeDatabases) {
  PrepareImages();
  for (const std::string side : {"left", "right"}) {
    fs::create_directories(Before() / side / side);
    for (int i = 0; i < 3; ++i) {
      WriteImage(Before() / side / side / (std::to_string(i) + ".pgm"), i);
    }
    Prepare("feature_extractor --database_path " + side +
            ".db --SiftExtraction.max_num_features 30 --image_path " + side);
  }
  Sweep({"database_merger",
         "database_merger --database_path1 left.db --database_path2 right.db "
         "--merged_database_path all.db",
         true, false, 2});
}

TEST_F(FaultTest, ImportFeatures) {
  fs::create_directories(Before());
  fs::copy_file(MGSFM_SOURCE_DIR "/tests/fuzz/corpus/hloc/features",
                Before() / "features.h5");
  if (Run("feature_importer --database_path a.db --import_path features.h5",
          Before(), {})
          .exit_code != 0) {
    GTEST_SKIP() << "this build reads no HDF5";
  }
  fs::remove(Before() / "a.db");
  Sweep({"feature_importer",
         "feature_importer --database_path a.db --import_path features.h5",
         false, false, 2});
}

// ------------------------------------------------- further commands on images

// Images that were written before the fault are not written again.
TEST_F(FaultTest, Undistort) {
  fs::create_directories(Before());
  Prepare(
      "simulate --output_path sim --rig mono --num_frames 2 "
      "--num_points_per_frame 60");
  for (const ModelImage& image :
       ReadModelPoses(Before() / "sim" / "truth").images) {
    WriteImage(Before() / "images" / image.name, image.id.value());
  }
  Prepare(
      "model_converter --input_path sim/truth --output_path small "
      "--output_type txt");
  // A lens that needs undistortion, and images of 80 x 60 pixels.
  const Camera camera = ReadModel(Before() / "sim" / "truth").cameras.at(0);
  WriteTextFile(Before() / "small" / "cameras.txt",
                std::to_string(camera.id.value()) +
                    " SIMPLE_RADIAL 80 60 60 40 30 0.1\n");
  Sweep({"image_undistorter",
         "image_undistorter --image_path images --input_path small "
         "--output_path out --num_threads 1",
         false, false, 2});
}

// ------------------------------------------------- further commands on models

class ModelFaultTest : public FaultTest,
                       public testing::WithParamInterface<FaultCase> {};

// Next to a drive: its model `sim/truth`, and positions of its images.
TEST_P(ModelFaultTest, OldOrNew) {
  PrepareDrive();
  fs::create_directories(Before() / "out");
  WriteTextFile(Before() / "out" / "notes.txt", "mine");
  Sweep(GetParam());
}

INSTANTIATE_TEST_SUITE_P(
    Commands, ModelFaultTest,
    testing::Values(
        FaultCase{"to_text",
                  "model_converter --input_path sim/truth --output_path out "
                  "--output_type txt",
                  true, false, 2},
        FaultCase{"to_ply",
                  "model_converter --input_path sim/truth --output_path a.ply "
                  "--output_type ply",
                  true, false, 2},
        FaultCase{"to_bundler",
                  "model_converter --input_path sim/truth --output_path a "
                  "--output_type bundler",
                  false, false, kFewRuns},
        FaultCase{"model_cropper",
                  "model_cropper --input_path sim/truth --output_path out "
                  "--boundary 0,1",
                  true, false, kFewRuns},
        FaultCase{"model_aligner",
                  "model_aligner --input_path sim/truth --output_path out "
                  "--ref_model_path sim/truth --transform_path t.txt",
                  false, false, kFewRuns},
        FaultCase{"model_merger",
                  "model_merger --input_path1 sim/truth --input_path2 "
                  "sim/truth --output_path out",
                  true, false, kFewRuns},
        FaultCase{"point_triangulator",
                  "point_triangulator --database_path sim/database.db "
                  "--input_path sim/truth --output_path out --num_threads 1",
                  true, false, kFewRuns},
        FaultCase{"report",
                  "report --input_path sim/truth --output_path report.html",
                  true, false, 2}),
    [](const auto& info) { return info.param.name; });

}  // namespace
}  // namespace mgsfm

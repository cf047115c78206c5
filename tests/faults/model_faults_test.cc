// SPDX-License-Identifier: BSD-3-Clause
// Commands that write models.
#include <cerrno>

#include "faults/fault_sweep.h"

namespace mgsfm {
namespace {

namespace fs = std::filesystem;

TEST_F(FaultTest, Simulate) {
  fs::create_directories(Before() / "out");
  WriteTextFile(Before() / "out" / "notes.txt", "mine");
  Sweep(
      {"simulate",
       "simulate --output_path out --num_frames 3 --num_points_per_frame 30"});
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

// An interrupted transaction is undone in a copy. If the files of the other
// program vanish meanwhile, more space for the copy is no remedy.
TEST_F(FaultTest, AJournalVanishesWhileItIsRead) {
  PrepareDrive();
  FaultPlan kill;
  kill.folder = Before().string();
  kill.fault = Fault::kKill;
  const fs::path journal = Before() / "sim" / "database.db-journal";
  while (!fs::exists(journal) || fs::file_size(journal) == 0) {
    ++kill.call;
    ASSERT_EQ(Run("database_cleaner --database_path sim/database.db --type all",
                  Before(), kill)
                  .exit_code,
              kKilledExitCode);
  }
  fs::copy(Before(), Sandbox(), fs::copy_options::recursive);
  FaultPlan vanished;
  vanished.folder = Sandbox().string();
  vanished.fault = Fault::kError;
  vanished.error = ENOENT;
  vanished.counted = CountedCalls::kChangesAndReads;
  int num_changed = 0;
  for (vanished.call = 0; vanished.call < 20; ++vanished.call) {
    const CommandOutput output =
        Run("mapper --database_path sim/database.db --output_path out "
            "--write_report 0 --num_threads 1",
            Sandbox(), vanished);
    EXPECT_TRUE(output.exit_code == 0 || output.exit_code == 1) << output.err;
    EXPECT_EQ(output.err.find("TMPDIR"), std::string::npos) << output.err;
    num_changed +=
        output.err.find("by another program") != std::string::npos ? 1 : 0;
  }
  EXPECT_GE(num_changed, 1);
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

TEST_F(FaultTest, Partition) {
  fs::create_directories(Before());
  Prepare(
      "simulate --output_path sim --num_frames 12 --num_points_per_frame 60");
  Sweep({"mapper_partition",
         "mapper --database_path sim/database.db --output_path out "
         "--partition 2 --partition_overlap 3",
         false, false, kFewRuns});
}

TEST_F(FaultTest, SplitAndJoin) {
  fs::create_directories(Before());
  Prepare(
      "simulate --output_path sim --num_frames 12 --num_points_per_frame 60");
  const std::string split =
      "model_splitter --input_path sim/truth --num_overlap_frames 3 ";
  fs::create_directories(Before() / "maps" / "0");
  Prepare(split + "--output_path parts");
  for (const char* i : {"0", "1"}) {
    fs::create_directories(Before() / "maps" / i);
    fs::rename(Before() / "parts" / i, Before() / "maps" / i / "0");
  }
  Sweep({"model_splitter", split + "--output_path out", false, false, 2});
  Sweep({"model_merger_graph",
         "model_merger --graph 1 --input_path maps --output_path out "
         "--num_threads 1",
         false, false, 2});
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

class ModelFaultTest : public FaultTest,
                       public testing::WithParamInterface<FaultCase> {};

// The inputs are a drive, its model `sim/truth`, a list of images and an NVM
// file.
TEST_P(ModelFaultTest, OldOrNew) {
  PrepareDrive();
  fs::create_directories(Before() / "out");
  WriteTextFile(Before() / "out" / "notes.txt", "mine");
  WriteImage(Before() / "a.pgm", 1);
  WriteTextFile(Before() / "ids.txt", "1\n2\n");
  WriteTextFile(Before() / "a.nvm",
                "NVM_V3\n\n1\na.pgm 90 1 0 0 0 0 0 0 0 0\n\n0\n\n0\n");
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
        FaultCase{"image_deleter",
                  "image_deleter --input_path sim/truth --output_path out "
                  "--image_ids_path ids.txt",
                  true, false, kFewRuns},
        FaultCase{"import_nvm",
                  "model_converter --input_path a.nvm --output_path out "
                  "--image_path .",
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

// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <cstdlib>
#include <optional>

#include "cli/program_runs.h"
#include "faults/system_calls.h"
#include "support/temp_dir.h"

namespace mgsfm {

constexpr int kManyRuns = 6;
// The steps of some commands are mostly those of others. scripts/faults.sh
// sweeps over all calls.
constexpr int kFewRuns = 1;

struct FaultCase {
  std::string name;
  std::string arguments;  // in the folder in which it runs
  // The output is complete at every instant, or not there. Otherwise the next
  // run continues with what is there.
  bool is_atomic = true;
  bool is_in_place = false;  // the output is the input
  int max_runs = kManyRuns;  // per kind of fault
  // Files below hold finished stages, for the next run, which removes them.
  std::string stages_folder = {};
  // The database of a command that leaves out images that it cannot read.
  std::string images_database = {};
};

// Runs a statement on a database.
void ExecuteSql(const std::filesystem::path& path, const std::string& sql);

// A gray image of 80 x 60 pixels.
void WriteImage(const std::filesystem::path& path, uint64_t seed);

// Runs of small commands in which one system call goes wrong. The environment
// variable MGSFM_FAULT_STRIDE selects every n-th call (default: some).
class FaultTest : public testing::Test {
 protected:
  FaultTest() {
    const char* stride = std::getenv("MGSFM_FAULT_STRIDE");
    if (stride != nullptr) stride_ = std::atoi(stride);
  }

  std::filesystem::path Before() const { return dir_.path() / "before"; }
  std::filesystem::path Sandbox() const { return dir_.path() / "run"; }

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
  void PrepareFeatures() const {
    PrepareImages();
    Prepare(
        "feature_extractor --database_path a.db --image_path images "
        "--SiftExtraction.max_num_features 60");
  }
  void PrepareDrive() const {
    std::filesystem::create_directories(Before());
    Prepare(
        "simulate --output_path sim --num_frames 4 --num_points_per_frame 60");
  }

  // Runs the program in a folder.
  static CommandOutput Run(const std::string& arguments,
                           const std::filesystem::path& folder,
                           const FaultPlan& plan);

  // Sweeps over the calls of the command and all kinds of faults.
  void Sweep(const FaultCase& command);

 private:
  void Restore() const {
    std::filesystem::remove_all(Sandbox());
    std::filesystem::copy(Before(), Sandbox(),
                          std::filesystem::copy_options::recursive);
  }
  void RunWithFault(const FaultCase& command, const FaultPlan& plan);
  void CheckState(const FaultCase& command, bool is_whole);

  const TempDir dir_;
  std::optional<long> stride_;  // otherwise that of FaultCase::max_runs
  Files old_, new_;
  std::string new_features_;  // by FeaturesByName
  int num_faults_ = 0;
};

}  // namespace mgsfm

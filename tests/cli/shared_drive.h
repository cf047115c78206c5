// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <gtest/gtest.h>

#include <memory>
#include <string>

#include "cli/program_runs.h"
#include "support/temp_dir.h"

namespace mgsfm {

// A folder `in` with a simulated drive, made once for all tests of a suite, and
// a new folder for the output of each. SetUpTestSuite of the suite calls
// Simulate.
class SharedDriveTest : public testing::Test {
 protected:
  // Simulates a drive; `arguments` are those of `mgsfm simulate`.
  static void Simulate(const std::string& arguments) {
    shared_ = std::make_unique<TempDir>();
    const CommandOutput output =
        RunMgsfm("simulate " + arguments + " --output_path " + In());
    ASSERT_EQ(output.exit_code, 0) << output.err;
  }
  // 60 frames of a stereo rig that come back to their start.
  static void SimulateLoop(const std::string& more = "") {
    Simulate(
        "--rig stereo --path loop --num_frames 60 --max_num_features 150 "
        "--num_points_per_frame 60 --pixel_noise 0.3 " +
        more);
  }
  static void TearDownTestSuite() { shared_.reset(); }

  static std::string In() { return (shared_->path() / "in").string(); }
  static std::string Database() { return In() + "/database.db"; }
  std::string Path(const std::string& name) const {
    return (dir_.path() / name).string();
  }

  const TempDir dir_;

 private:
  static inline std::unique_ptr<TempDir> shared_;
};

}  // namespace mgsfm

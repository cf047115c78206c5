// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <filesystem>
#include <string>
#include <vector>

namespace mgsfm {

// What a stage of a run took, or the whole run.
struct StageCost {
  std::string name;
  double seconds = 0.0;
  double processor_seconds = 0.0;
  double peak_memory_mib = 0.0;  // of the process, until the stage ended
};

// A run of the mapper, from its report.
struct GrowthRun {
  int num_images = 0;
  int num_registered = 0;
  double num_observations = 0.0;  // of all tracks
  std::vector<StageCost> stages;
  StageCost total;
};

// All *.json in a folder, by number of images. Throws Error for one that is no
// report.
std::vector<GrowthRun> ReadGrowthRuns(const std::filesystem::path& folder);

// The cost of a stage by name; of zeros if the run has none.
StageCost FindStage(const GrowthRun& run, const std::string& name);

// The exponent p that fits value = c observations^p best, by least squares on
// logarithms; 0 with fewer than two runs.
double FitExponent(const std::vector<GrowthRun>& runs, const std::string& stage,
                   double StageCost::*value);

// As SVG, over the observations and all on logarithmic scales: above,
// processor seconds of the stages and of all together; below, peak memory.
std::string GrowthToSvg(const std::vector<GrowthRun>& runs);

constexpr char kTotalName[] = "total";

}  // namespace mgsfm

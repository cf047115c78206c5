// SPDX-License-Identifier: BSD-3-Clause
// Tables, exponents and a plot of how the mapper grows with its input, from
// the reports of its runs.
#include <cstdio>
#include <string>
#include <vector>

#include "command.h"
#include "io/files/output_file.h"
#include "mgsfm/base/error.h"
#include "report/growth.h"

namespace mgsfm {
namespace {

struct ReportOptions {
  std::string input_path;
  std::string svg_path;

  template <class Self, class Visitor>
  static void Describe(Self& self, Visitor& visit) {
    visit("input_path", self.input_path, Required(), "",
          "Folder with the reports of the mapper, *.json.");
    visit("svg_path", self.svg_path, AnyValue(), "", "File for a plot.");
  }
};

void PrintRuns(const std::vector<GrowthRun>& runs) {
  std::printf(
      "| images | registered | observations | wall | processors | peak memory "
      "|\n|---|---|---|---|---|---|\n");
  for (const GrowthRun& run : runs) {
    std::printf("| %d | %d | %.0f | %.1f s | %.1f s | %.0f MiB |\n",
                run.num_images, run.num_registered, run.num_observations,
                run.total.seconds, run.total.processor_seconds,
                run.total.peak_memory_mib);
  }
  std::printf("| exponent | | | %.2f | %.2f | %.2f |\n",
              FitExponent(runs, kTotalName, &StageCost::seconds),
              FitExponent(runs, kTotalName, &StageCost::processor_seconds),
              FitExponent(runs, kTotalName, &StageCost::peak_memory_mib));
}

// Wall and processor seconds and the peak of memory after each stage.
void PrintStages(const std::vector<GrowthRun>& runs) {
  std::printf("\n| stage |");
  for (const GrowthRun& run : runs) std::printf(" %d |", run.num_images);
  std::printf(" exponent of processor time |\n|---|");
  for (size_t i = 0; i <= runs.size(); ++i) std::printf("---|");
  std::printf("\n");
  for (const StageCost& stage : runs.back().stages) {
    std::printf("| %s |", stage.name.c_str());
    for (const GrowthRun& run : runs) {
      const StageCost cost = FindStage(run, stage.name);
      std::printf(" %.2f s, %.2f s, %.0f MiB |", cost.seconds,
                  cost.processor_seconds, cost.peak_memory_mib);
    }
    std::printf(" %.2f |\n",
                FitExponent(runs, stage.name, &StageCost::processor_seconds));
  }
}

int RunReport(const ReportOptions& options, const Context&) {
  const std::vector<GrowthRun> runs = ReadGrowthRuns(options.input_path);
  if (runs.empty()) throw Error("no report in '" + options.input_path + "'");
  PrintRuns(runs);
  PrintStages(runs);
  if (!options.svg_path.empty()) {
    WriteFile(options.svg_path, GrowthToSvg(runs));
  }
  return kExitSuccess;
}

}  // namespace
}  // namespace mgsfm

int main(int argc, char** argv) {
  try {
    return mgsfm::MakeCommand("growth_report",
                              "How the mapper grows with its input.",
                              mgsfm::RunReport)
        .run(std::vector<std::string>(argv + 1, argv + argc));
  } catch (const std::exception& error) {
    std::fprintf(stderr, "mgsfm_growth_report: %s\n", error.what());
    return mgsfm::kExitBadInput;
  }
}

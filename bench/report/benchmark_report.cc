// SPDX-License-Identifier: BSD-3-Clause
// Tables and plots of the runs of mgsfm_oracle_benchmark, from their JSON.
#include <algorithm>
#include <cstdarg>
#include <cstdio>
#include <iostream>
#include <string>
#include <vector>

#include "command.h"
#include "io/files/output_file.h"
#include "mgsfm/base/error.h"
#include "report/benchmark_run.h"
#include "report/curve_plot.h"

namespace mgsfm {
namespace {

struct ReportOptions {
  std::string input_path;
  std::string svg_path;
  std::string title;
  std::string setting;
  std::string x_label;
  double x_factor = 1.0;
  double max_oracle_ratio = 1.1;
  double max_full_oracle_ratio = 1.3;

  template <class Self, class Visitor>
  static void Describe(Self& self, Visitor& visit) {
    visit("input_path", self.input_path, Required(), "",
          "Folder with the JSON files of runs.");
    visit("svg_path", self.svg_path, AnyValue(), "",
          "File for a plot over `setting`; without, a table is printed.");
    visit("title", self.title, AnyValue(), "", "Of the plot.");
    visit("setting", self.setting, AnyValue(), "",
          "Option of the simulation along the x axis.");
    visit("x_label", self.x_label, AnyValue(), "", "Of the x axis, with unit.");
    visit("x_factor", self.x_factor, GreaterThan(0.0), "",
          "From the option to the unit of the x axis.");
    visit("max_oracle_ratio", self.max_oracle_ratio, GreaterThan(0.0), "",
          "In the table, larger ones are bold.");
    visit("max_full_oracle_ratio", self.max_full_oracle_ratio, GreaterThan(0.0),
          "", "Likewise.");
  }
};

__attribute__((format(printf, 1, 2))) std::string Format(const char* format,
                                                         ...) {
  char text[256];
  va_list arguments;
  va_start(arguments, format);
  std::vsnprintf(text, sizeof(text), format, arguments);
  va_end(arguments);
  return text;
}

std::string BoldIf(bool is_bold, const std::string& text) {
  return is_bold ? "**" + text + "**" : text;
}

// The worst of the poses in the rig.
std::string RigCell(const BenchmarkRun& run) {
  double rotation_deg = 0.0, position_m = 0.0;
  for (const auto& sensor : run.json.at("mapper").at("rig")) {
    rotation_deg = std::max(rotation_deg, sensor.value("rotation_deg", 0.0));
    position_m = std::max(position_m, sensor.value("position_m", 0.0));
  }
  return Format("%.4f deg, %.4f m", rotation_deg, position_m);
}

std::string Row(const BenchmarkRun& run, const ReportOptions& options) {
  const int num_images = run.NumImages();
  const int num_registered = run.NumRegistered();
  std::string row = "| " + run.name + " | " +
                    BoldIf(num_registered < num_images,
                           Format("%d of %d", num_registered, num_images));
  const double seconds = run.json.at("seconds").at("mapper");
  const double memory_mib = run.json.at("peak_memory_mib");
  const std::string end = Format(" | %.0f s | %.0f MiB |", seconds, memory_mib);
  if (!run.HasModel()) return row + " | | | | | | " + end;
  const double ratio = run.json.at("oracle_ratio");
  const double full_ratio = run.json.at("full_oracle_ratio");
  row += Format(" | %.4f m | %.4f m | ", run.PositionM("mapper"),
                run.PositionM("oracle"));
  row += BoldIf(ratio > options.max_oracle_ratio, Format("%.3f", ratio));
  row += Format(" | %.4f m | ", run.PositionM("full_oracle"));
  row += BoldIf(full_ratio > options.max_full_oracle_ratio,
                Format("%.3f", full_ratio));
  row += Format(" | %.4f deg | ", run.RotationDeg("mapper"));
  return row + RigCell(run) + end;
}

bool IsWithinBounds(const BenchmarkRun& run, const ReportOptions& options) {
  return run.HasModel() && run.NumRegistered() == run.NumImages() &&
         run.json.at("oracle_ratio") <= options.max_oracle_ratio &&
         run.json.at("full_oracle_ratio") <= options.max_full_oracle_ratio;
}

void PrintTable(const std::vector<BenchmarkRun>& runs,
                const ReportOptions& options) {
  std::cout << "| run | registered | position, mean | oracle | ratio | full "
               "oracle | ratio | rotation, mean | rig, worst | mapper | peak "
               "memory |\n|---|---|---|---|---|---|---|---|---|---|---|\n";
  size_t num_good = 0;
  for (const BenchmarkRun& run : runs) {
    std::cout << Row(run, options) << "\n";
    num_good += IsWithinBounds(run, options) ? 1 : 0;
  }
  std::cout << Format(
      "\n%zu of %zu runs registered all images with ratios of at most %g and "
      "%g.\n",
      num_good, runs.size(), options.max_oracle_ratio,
      options.max_full_oracle_ratio);
}

int RunReport(const ReportOptions& options, const Context&) {
  const std::vector<BenchmarkRun> runs = ReadRuns(options.input_path);
  if (runs.empty()) throw Error("no run in '" + options.input_path + "'");
  if (options.svg_path.empty()) {
    PrintTable(runs, options);
    return kExitSuccess;
  }
  if (options.setting.empty()) throw Error("--svg_path needs --setting");
  WriteFile(options.svg_path,
            CurvesToSvg(runs, {options.title, options.setting, options.x_label,
                               options.x_factor}));
  return kExitSuccess;
}

}  // namespace
}  // namespace mgsfm

int main(int argc, char** argv) {
  try {
    return mgsfm::MakeCommand("benchmark_report",
                              "Tables and plots of benchmark runs.",
                              mgsfm::RunReport)
        .run(std::vector<std::string>(argv + 1, argv + argc));
  } catch (const std::exception& error) {
    std::fprintf(stderr, "mgsfm_benchmark_report: %s\n", error.what());
    return mgsfm::kExitBadInput;
  }
}

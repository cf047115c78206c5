// SPDX-License-Identifier: BSD-3-Clause
#include "report/growth.h"

#include <algorithm>
#include <cmath>
#include <fstream>
#include <nlohmann/json.hpp>

#include "mgsfm/base/error.h"

namespace mgsfm {
namespace {

using Json = nlohmann::ordered_json;

// Adds the stages of a run or of one of its models.
void AddStages(const Json& json, GrowthRun* run) {
  const Json& seconds = json.at("seconds");
  for (const auto& [name, value] : seconds.items()) {
    auto stage = std::find_if(
        run->stages.begin(), run->stages.end(),
        [name = name](const StageCost& s) { return s.name == name; });
    if (stage == run->stages.end()) {
      run->stages.push_back({name});
      stage = run->stages.end() - 1;
    }
    stage->seconds += value.get<double>();
    stage->processor_seconds +=
        json.at("processor_seconds").at(name).get<double>();
    stage->peak_memory_mib =
        std::max(stage->peak_memory_mib,
                 json.at("peak_memory_mib_after").at(name).get<double>());
  }
}

GrowthRun ReadRun(const Json& report) {
  GrowthRun run;
  run.num_images = report.at("input").at("num_images");
  AddStages(report, &run);
  for (const Json& model : report.at("models")) {
    run.num_registered += model.at("num_images").get<int>();
    run.num_observations +=
        model.at("tracks").at("num_observations").get<double>();
    AddStages(model, &run);
  }
  run.total.name = kTotalName;
  for (const StageCost& stage : run.stages) {
    run.total.seconds += stage.seconds;
    run.total.processor_seconds += stage.processor_seconds;
  }
  run.total.peak_memory_mib = report.at("peak_memory_mib");
  return run;
}

}  // namespace

std::vector<GrowthRun> ReadGrowthRuns(const std::filesystem::path& folder) {
  if (!std::filesystem::is_directory(folder)) {
    throw Error("'" + folder.string() + "' is no folder");
  }
  std::vector<GrowthRun> runs;
  for (const auto& entry : std::filesystem::directory_iterator(folder)) {
    if (entry.path().extension() != ".json") continue;
    std::ifstream file(entry.path());
    try {
      runs.push_back(ReadRun(Json::parse(file)));
    } catch (const nlohmann::json::exception& error) {
      throw Error("'" + entry.path().string() +
                  "' is no report of the mapper: " + error.what());
    }
  }
  std::sort(runs.begin(), runs.end(),
            [](const GrowthRun& a, const GrowthRun& b) {
              return a.num_images < b.num_images;
            });
  return runs;
}

StageCost FindStage(const GrowthRun& run, const std::string& name) {
  if (name == kTotalName) return run.total;
  for (const StageCost& stage : run.stages) {
    if (stage.name == name) return stage;
  }
  return {name};
}

double FitExponent(const std::vector<GrowthRun>& runs, const std::string& stage,
                   double StageCost::*value) {
  std::vector<double> x, y;
  for (const GrowthRun& run : runs) {
    const double v = FindStage(run, stage).*value;
    if (!(v > 0.0 && run.num_observations > 0.0)) continue;
    x.push_back(std::log(run.num_observations));
    y.push_back(std::log(v));
  }
  if (x.size() < 2) return 0.0;
  double mean_x = 0.0, mean_y = 0.0;
  for (size_t i = 0; i < x.size(); ++i) {
    mean_x += x[i] / static_cast<double>(x.size());
    mean_y += y[i] / static_cast<double>(x.size());
  }
  double xx = 0.0, xy = 0.0;
  for (size_t i = 0; i < x.size(); ++i) {
    xx += (x[i] - mean_x) * (x[i] - mean_x);
    xy += (x[i] - mean_x) * (y[i] - mean_y);
  }
  return xx > 0.0 ? xy / xx : 0.0;
}

}  // namespace mgsfm

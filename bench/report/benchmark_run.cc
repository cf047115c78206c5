// SPDX-License-Identifier: BSD-3-Clause
#include "report/benchmark_run.h"

#include <algorithm>
#include <fstream>

#include "mgsfm/base/error.h"

namespace mgsfm {

double BenchmarkRun::Setting(const std::string& option) const {
  return json.at("options").at("Simulation").at(option);
}

std::string BenchmarkRun::Rig() const {
  return json.at("options").at("Simulation").at("rig");
}

int BenchmarkRun::NumImages() const {
  return json.at("input").at("num_images");
}

int BenchmarkRun::NumRegistered() const {
  if (!HasModel()) return 0;
  return json.at("mapper").at("num_registered");
}

double BenchmarkRun::RegisteredPercent() const {
  return 100.0 * NumRegistered() / std::max(1, NumImages());
}

double BenchmarkRun::PositionM(const std::string& of) const {
  return json.at(of).at("position_m").at("mean");
}

double BenchmarkRun::RotationDeg(const std::string& of) const {
  return json.at(of).at("rotation_deg").at("mean");
}

std::vector<BenchmarkRun> ReadRuns(const std::filesystem::path& folder) {
  if (!std::filesystem::is_directory(folder)) {
    throw Error("'" + folder.string() + "' is no folder");
  }
  std::vector<BenchmarkRun> runs;
  for (const auto& entry : std::filesystem::directory_iterator(folder)) {
    if (entry.path().extension() != ".json") continue;
    std::ifstream file(entry.path());
    BenchmarkRun run;
    run.json = nlohmann::json::parse(file, nullptr, false);
    if (run.json.is_discarded() || !run.json.contains("options")) {
      throw Error("'" + entry.path().string() + "' is no run of a benchmark");
    }
    run.name = run.json.value("name", "");
    runs.push_back(std::move(run));
  }
  std::sort(runs.begin(), runs.end(),
            [](const BenchmarkRun& a, const BenchmarkRun& b) {
              return a.name < b.name;
            });
  return runs;
}

}  // namespace mgsfm

// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <filesystem>
#include <nlohmann/json.hpp>
#include <string>
#include <vector>

namespace mgsfm {

// What mgsfm_oracle_benchmark wrote of one run.
struct BenchmarkRun {
  std::string name;
  nlohmann::json json;

  bool HasModel() const { return json.contains("mapper"); }
  // A value of the simulation, by the name of its option.
  double Setting(const std::string& option) const;
  std::string Rig() const;
  int NumImages() const;
  int NumRegistered() const;
  double RegisteredPercent() const;
  // Means over images of "mapper", "oracle" or "full_oracle"; only with model.
  double PositionM(const std::string& of) const;
  double RotationDeg(const std::string& of) const;
};

// All *.json in a folder, by name. Throws Error for one that is no such run.
std::vector<BenchmarkRun> ReadRuns(const std::filesystem::path& folder);

}  // namespace mgsfm

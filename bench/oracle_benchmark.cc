// SPDX-License-Identifier: BSD-3-Clause
// Simulates a drive, runs the mapper on it in memory, and compares the result
// with the two oracles of oracle/oracle.h. Prints a summary line and writes all
// numbers as JSON.
#include <algorithm>
#include <cstdio>
#include <limits>
#include <nlohmann/json.hpp>
#include <string>
#include <vector>

#include "command.h"
#include "files/file_operations.h"
#include "mgsfm/base/error.h"
#include "mgsfm/base/timer.h"
#include "mgsfm/mapper/mapper.h"
#include "mgsfm/simulator/simulation.h"
#include "oracle/oracle.h"
#include "simulated_run.h"

namespace mgsfm {
namespace {

using Json = nlohmann::ordered_json;

Json ToJson(const std::optional<ErrorStatistics>& statistics) {
  if (!statistics) return nullptr;
  return {{"mean", statistics->mean},
          {"median", statistics->median},
          {"max", statistics->max}};
}

Json ToJson(const ModelErrors& errors) {
  Json json = {{"num_registered", errors.num_registered},
               {"position_m", ToJson(errors.position_m)},
               {"rotation_deg", ToJson(errors.rotation_deg)},
               {"rig", Json::array()}};
  for (const RigErrors& sensor : errors.rig) {
    json["rig"].push_back({{"sensor", sensor.sensor},
                           {"rotation_deg", sensor.rotation_deg},
                           {"position_m", sensor.position_m},
                           {"true_distance_m", sensor.true_distance_m}});
  }
  return json;
}

Json ToJson(const OracleResult& oracle) {
  Json json = ToJson(oracle.errors);
  json["num_points"] = oracle.num_points;
  json["num_observations"] = oracle.num_observations;
  json["num_iterations"] = oracle.solve.num_iterations;
  json["termination"] = EnumName(oracle.solve.termination);
  json["seconds"] = oracle.seconds;
  return json;
}

// Statistics of all verified matches.
double ShareOfRightMatches(const Simulation& simulation) {
  size_t num_matches = 0, num_right = 0;
  for (const ImagePair& pair : simulation.view_graph.pairs) {
    const auto& points1 = simulation.keypoint_points[pair.image_idx1];
    const auto& points2 = simulation.keypoint_points[pair.image_idx2];
    for (const Match& match : pair.matches) {
      const int point = points1[match.keypoint_idx1];
      num_right += point >= 0 && point == points2[match.keypoint_idx2] ? 1 : 0;
      ++num_matches;
    }
  }
  return num_matches == 0 ? 0.0
                          : static_cast<double>(num_right) /
                                static_cast<double>(num_matches);
}

Json InputToJson(const Simulation& simulation) {
  size_t num_matches = 0;
  for (const ImagePair& pair : simulation.view_graph.pairs) {
    num_matches += pair.matches.size();
  }
  const auto num_true =
      std::count(simulation.pair_kinds.begin(), simulation.pair_kinds.end(),
                 PairKind::kTrue);
  return {{"num_frames", simulation.scene.frames.size()},
          {"num_images", simulation.scene.images.size()},
          {"num_pairs", simulation.view_graph.pairs.size()},
          {"num_true_pairs", num_true},
          {"num_matches", num_matches},
          {"share_of_right_matches", ShareOfRightMatches(simulation)}};
}

Json SecondsToJson(const MapperResult& result, double total) {
  Json json;
  for (const StageTime& time : result.times) json[time.stage] = time.seconds;
  for (const MapperModel& model : result.models) {
    for (const StageTime& time : model.times) {
      json[time.stage] = json.value(time.stage, 0.0) + time.seconds;
    }
  }
  json["mapper"] = total;
  return json;
}

// NaN if no image is registered.
double Mean(const std::optional<ErrorStatistics>& statistics) {
  return statistics ? statistics->mean
                    : std::numeric_limits<double>::quiet_NaN();
}

void PrintLine(const std::string& name, const Simulation& simulation,
               const std::optional<OracleComparison>& comparison,
               double seconds) {
  if (!comparison) {
    std::printf("%s: nothing was reconstructed, %.1f s\n", name.c_str(),
                seconds);
    return;
  }
  const ModelErrors& mapper = comparison->mapper;
  std::printf(
      "%s: %d of %zu images, position %.4f m (oracle %.4f, full %.4f: ratios "
      "%.3f, %.3f), rotation %.4f deg (oracle %.4f, full %.4f), %.1f s\n",
      name.c_str(), mapper.num_registered, simulation.scene.images.size(),
      Mean(mapper.position_m), Mean(comparison->oracle.errors.position_m),
      Mean(comparison->full_oracle.errors.position_m),
      comparison->OracleRatio(), comparison->FullOracleRatio(),
      Mean(mapper.rotation_deg), Mean(comparison->oracle.errors.rotation_deg),
      Mean(comparison->full_oracle.errors.rotation_deg), seconds);
}

void AddComparison(const OracleComparison& comparison, const MapperModel& model,
                   Json* json) {
  (*json)["mapper"] = ToJson(comparison.mapper);
  (*json)["mapper"]["num_points"] = model.reconstruction.points.size();
  (*json)["loss_scale_px"] = comparison.loss_scale_px;
  (*json)["oracle"] = ToJson(comparison.oracle);
  (*json)["full_oracle"] = ToJson(comparison.full_oracle);
  (*json)["oracle_ratio"] = comparison.OracleRatio();
  (*json)["full_oracle_ratio"] = comparison.FullOracleRatio();
}

int RunBenchmark(const SimulatedRunOptions& options, const Context& context) {
  const Timer simulating;
  const Simulation simulation = SimulateRun(options, context);
  Json json = {{"name", options.name},
               {"options", Json::parse(OptionsToJsonOf(options))},
               {"random_seed", context.random_seed},
               {"num_threads", context.num_threads},
               {"input", InputToJson(simulation)}};
  json["simulation_seconds"] = simulating.Seconds();
  json["simulation_peak_memory_mib"] = PeakMemoryMib();

  const Timer mapping;
  const MapperResult result = RunMapper(
      {simulation.scene, simulation.view_graph}, options.mapper, context);
  const double seconds = mapping.Seconds();
  json["seconds"] = SecondsToJson(result, seconds);
  json["peak_memory_mib"] = PeakMemoryMib();
  json["num_models"] = result.models.size();
  const auto comparison = CompareWithOracles(
      simulation, result, options.mapper.bundle_adjustment, context);
  if (comparison) AddComparison(*comparison, result.models.front(), &json);
  if (!options.json_path->empty()) {
    WriteFile(*options.json_path, json.dump(2) + "\n");
  }
  PrintLine(options.name, simulation, comparison, seconds);
  return comparison ? kExitSuccess : kExitNotSolvable;
}

SimulatedRunOptions& DriveOf(SimulatedRunOptions& options) { return options; }

}  // namespace
}  // namespace mgsfm

int main(int argc, char** argv) {
  try {
    return mgsfm::RunOnDrive(
        "oracle_benchmark",
        "Compares the mapper with the best that its input allows.",
        std::vector<std::string>(argv + 1, argv + argc), mgsfm::DriveOf,
        mgsfm::RunBenchmark);
  } catch (const std::exception& error) {
    std::fprintf(stderr, "mgsfm_oracle_benchmark: %s\n", error.what());
    return mgsfm::kExitBadInput;
  }
}

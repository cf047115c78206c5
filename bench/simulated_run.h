// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <string>
#include <vector>

#include "command.h"
#include "mgsfm/base/context.h"
#include "mgsfm/base/options.h"
#include "mgsfm/mapper/mapper.h"
#include "mgsfm/models/trajectory_io.h"
#include "mgsfm/simulator/simulation.h"

namespace mgsfm {

// Common options of the benchmarks on simulated drives.
struct SimulatedRunOptions {
  Option<std::string> name{"name", "", "What the run is called in its output."};
  Option<SimulationPreset> preset{
      "preset", SimulationPreset::kStandard,
      "Defaults of the options of Simulation, as of mgsfm simulate."};
  Option<std::string> trajectory_path{
      "trajectory_path", "",
      "Poses in KITTI's format, instead of Simulation.path."};
  Option<std::string> json_path{"json_path", "",
                                "File for all numbers of the run."};
  SimulationOptions simulation;
  MapperOptions mapper;

  template <class Visitor>
  void Describe(Visitor& visit) {
    visit(name, preset, trajectory_path, json_path);
    visit.Group("Simulation", simulation);
    visit.Group("Mapper", mapper);
  }
};

inline Simulation SimulateRun(const SimulatedRunOptions& options,
                              const Context& context) {
  SimulationOptions simulation = options.simulation;
  simulation.random_seed = context.random_seed;
  SimulationInput input;
  if (!options.trajectory_path->empty()) {
    input.rig_from_world_path = ReadKittiPoses(*options.trajectory_path);
  }
  return Simulate(simulation, input, context);
}

// Runs a benchmark. Its options start from those of the preset that the
// arguments name; `drive_of` returns the part that defines the drive.
template <class Options>
int RunOnDrive(const std::string& name, const std::string& summary,
               const std::vector<std::string>& arguments,
               SimulatedRunOptions& (*drive_of)(Options&),
               int (*run)(const Options&, const Context&)) {
  AllOptions<Options> preset;
  SetOptions(arguments, ListOptions(&preset));
  AllOptions<Options> options;
  drive_of(options.command).simulation = PresetSimulation(
      drive_of(preset.command).preset, SimulationOptions().rig);
  if (!ParseArguments(name, summary, arguments, ListOptions(&options))) {
    return kExitSuccess;
  }
  return run(options.command, MakeTerminalContext(options.common));
}

}  // namespace mgsfm

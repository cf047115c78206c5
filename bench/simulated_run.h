// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <string>

#include "mgsfm/base/context.h"
#include "mgsfm/base/options.h"
#include "mgsfm/io/models/trajectory_io.h"
#include "mgsfm/pipeline/mapper.h"
#include "mgsfm/synthetic/simulation.h"

namespace mgsfm {

// Common options of the benchmarks on simulated drives.
struct SimulatedRunOptions {
  Option<std::string> name{"name", "", "What the run is called in its output."};
  Option<std::string> trajectory_path{
      "trajectory_path", "",
      "Poses in KITTI's format, instead of Simulation.path."};
  Option<std::string> json_path{"json_path", "",
                                "File for all numbers of the run."};
  SimulationOptions simulation = StandardSimulation(RigPreset::kStereo);
  MapperOptions mapper;

  template <class Visitor>
  void Describe(Visitor& visit) {
    visit(name, trajectory_path, json_path);
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

}  // namespace mgsfm

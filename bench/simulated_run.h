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
  std::string name;
  std::string trajectory_path;
  std::string json_path;
  SimulationOptions simulation = StandardSimulation(RigPreset::kStereo);
  MapperOptions mapper;

  template <class Self, class Visitor>
  static void Describe(Self& self, Visitor& visit) {
    visit("name", self.name, AnyValue(), "",
          "What the run is called in its output.");
    visit("trajectory_path", self.trajectory_path, AnyValue(), "",
          "Poses in KITTI's format, instead of Simulation.path.");
    visit("json_path", self.json_path, AnyValue(), "",
          "File for all numbers of the run.");
    visit.Group("Simulation", self.simulation);
    visit.Group("Mapper", self.mapper);
  }
};

inline Simulation SimulateRun(const SimulatedRunOptions& options,
                              const Context& context) {
  SimulationOptions simulation = options.simulation;
  simulation.random_seed = context.random_seed;
  SimulationInput input;
  if (!options.trajectory_path.empty()) {
    input.rig_from_world_path = ReadKittiPoses(options.trajectory_path);
  }
  return Simulate(simulation, input, context);
}

}  // namespace mgsfm

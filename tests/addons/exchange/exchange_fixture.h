// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <optional>
#include <sstream>
#include <string>
#include <vector>

#include "exchange/exchange_formats.h"
#include "mgsfm/simulator/simulation.h"

namespace mgsfm {

inline Simulation Drive(RigPreset rig) {
  SimulationOptions options;
  options.rig = rig;
  options.num_frames = 5;
  options.num_points_per_frame = 40;
  options.max_num_features_per_image = 30;
  return Simulate(options);
}

inline std::vector<ExportedFile> Export(
    const std::string& format, const Simulation& drive,
    TrajectoryPoses poses = TrajectoryPoses::kFrame,
    const std::optional<Eigen::Vector3d>& origin = std::nullopt) {
  return FindExchangeFormat(format)->write(
      {drive.scene, drive.ground_truth, poses, origin});
}

// The lines that are no comments.
inline std::vector<std::string> Lines(const std::string& text) {
  std::vector<std::string> lines;
  std::istringstream stream(text);
  for (std::string line; std::getline(stream, line);) {
    if (!line.empty() && line[0] != '#') lines.push_back(line);
  }
  return lines;
}

}  // namespace mgsfm

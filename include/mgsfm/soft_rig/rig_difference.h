// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <optional>

namespace mgsfm {

// A sensor whose pose in a model contradicts that in a larger one.
struct RigDifference {
  int sensor_idx = 0;
  double rotation_deg = 0.0;
  double sigma_rotation_deg = 0.0;      // of the difference, about its axis
  std::optional<double> distance = {};  // nullopt: no length is determined
  double sigma_distance = 0.0;          // along the difference
};

}  // namespace mgsfm

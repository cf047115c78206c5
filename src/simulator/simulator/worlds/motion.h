// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <Eigen/Core>
#include <cstdint>
#include <vector>

#include "simulator/worlds/world_plan.h"

namespace mgsfm {

// Position (x, y, z) and direction (yaw to the left of the x axis, pitch down,
// roll) of a camera whose z axis points ahead and whose y axis points down.
using Attitude = Eigen::Matrix<double, 6, 1>;
Attitude At(double x, double y, double z, double yaw_deg,
            double pitch_deg = 0.0, double roll_deg = 0.0);
Rigid3 WorldFromRig(const Attitude& attitude);
// The attitude at `eye` of a camera that looks at `target`.
Attitude LookAt(const Eigen::Vector3d& eye, const Eigen::Vector3d& target);

struct Key {
  double time_s;
  Attitude attitude;
};

// Smooth and monotonic between keys: two equal keys are a stop.
std::function<Attitude(double)> Follow(std::vector<Key> keys);

// A sum of oscillations with random phases.
class Tremor {
 public:
  Tremor(double position_m, double angle_deg, double min_frequency_hz,
         double max_frequency_hz, uint64_t seed);
  Attitude operator()(double time_s) const;

 private:
  struct Wave {
    Attitude amplitude;
    Attitude phase;
    double frequency_hz;
  };
  std::vector<Wave> waves_;
};

}  // namespace mgsfm

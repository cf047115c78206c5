// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include "simulator/position_measurement.h"

namespace mgsfm {

// Measured positions of a simulation.
inline PositionPriors MeasuredPositions(const Simulation& simulation,
                                        double sigma_m, double outlier_ratio) {
  PositionMeasurementOptions options;
  options.sigma_m = sigma_m;
  options.outlier_ratio = outlier_ratio;
  return MeasurePositions(simulation, options, 0);
}

// Measured directions of gravity of a simulation.
inline GravityPriors MeasuredGravity(const Simulation& simulation,
                                     double sigma_deg, double outlier_ratio) {
  GravityMeasurementOptions options;
  options.sigma_deg = sigma_deg;
  options.outlier_ratio = outlier_ratio;
  return MeasureGravity(simulation, options, 0);
}

}  // namespace mgsfm

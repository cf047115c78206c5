// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <cstdint>

#include "mgsfm/base/options.h"
#include "mgsfm/scene/gravity_priors.h"
#include "mgsfm/scene/position_priors.h"
#include "mgsfm/synthetic/simulation.h"

namespace mgsfm {

struct PositionMeasurementOptions {
  double sigma_m = 0.0;  // 0: no measured positions
  double outlier_ratio = 0.0;

  template <class Self, class Visitor>
  static void Describe(Self& self, Visitor& visit) {
    visit("prior_sigma", self.sigma_m, AtLeast(0.0), "m",
          "Write measured positions of one image of each frame to pose_priors, "
          "with this standard deviation of each coordinate; 0: none.");
    visit("prior_outlier_ratio", self.outlier_ratio, Between(0.0, 0.9), "",
          "Share of measured positions that are 20 to 200 m off.");
  }
};

// Measured positions of the first image of each frame, in the world of the
// simulation. Empty without a standard deviation.
PositionPriors MeasurePositions(const Simulation& simulation,
                                const PositionMeasurementOptions& options,
                                uint64_t random_seed);

struct GravityMeasurementOptions {
  double sigma_deg = 0.0;  // 0: no measured gravity
  double outlier_ratio = 0.0;

  template <class Self, class Visitor>
  static void Describe(Self& self, Visitor& visit) {
    visit("gravity_sigma", self.sigma_deg, AtLeast(0.0), "deg",
          "Write the measured direction of gravity of one image of each frame "
          "to gravity.txt, with this standard deviation of each of two axes; "
          "0: none.");
    visit("gravity_outlier_ratio", self.outlier_ratio, Between(0.0, 0.9), "",
          "Share of them that point anywhere.");
  }
};

// Measured gravity, +y of the world, in the first image of each frame. Empty
// without a standard deviation.
GravityPriors MeasureGravity(const Simulation& simulation,
                             const GravityMeasurementOptions& options,
                             uint64_t random_seed);

}  // namespace mgsfm

// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <cstdint>

#include "mgsfm/base/options.h"
#include "mgsfm/scene/priors.h"
#include "mgsfm/simulator/simulation.h"

namespace mgsfm {

struct PositionMeasurementOptions {
  Option<double> sigma_m{
      "prior_sigma", 0.0, AtLeast(0.0), "m",
      "Set the standard deviation of each coordinate of the measured positions "
      "of frames in the table pose_priors. 0 writes no positions."};
  Option<double> outlier_ratio{
      "prior_outlier_ratio", 0.0, Between(0.0, 0.9),
      "Set the fraction of measured positions with an error of 20 to 200 m."};

  template <class Visitor>
  void Describe(Visitor& visit) {
    visit(sigma_m, outlier_ratio);
  }
};

// Measured positions of the first image of each frame in the world frame of the
// simulation. Empty if sigma_m is 0.
PositionPriors MeasurePositions(const Simulation& simulation,
                                const PositionMeasurementOptions& options,
                                uint64_t random_seed);

struct GravityMeasurementOptions {
  Option<double> sigma_deg{
      "gravity_sigma", 0.0, AtLeast(0.0), "deg",
      "Set the standard deviation, about each of two axes, of the measured "
      "directions of gravity in gravity.txt, one image per frame. 0 writes no "
      "file."};
  Option<double> outlier_ratio{
      "gravity_outlier_ratio", 0.0, Between(0.0, 0.9),
      "Set the fraction of gravity measurements with a random direction."};

  template <class Visitor>
  void Describe(Visitor& visit) {
    visit(sigma_deg, outlier_ratio);
  }
};

// Measured gravity, +y in the world frame, for the first image of each frame.
// Empty if sigma_deg is 0.
GravityPriors MeasureGravity(const Simulation& simulation,
                             const GravityMeasurementOptions& options,
                             uint64_t random_seed);

}  // namespace mgsfm

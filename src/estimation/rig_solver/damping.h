// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include "base/cpu_features.h"

namespace mgsfm {

// The lower bound of the damping diagonal D, as in Ceres.
constexpr double kMinDamping = 1e-6;

MGSFM_ALWAYS_INLINE double ClampDiagonal(double value) {
  return value < kMinDamping ? kMinDamping : value;
}

// Sums over the eliminated points of a chunk.
struct StepSums {
  double cost = 0.0;      // at the new state
  double decrease = 0.0;  // lambda d^T D d - g^T d
  double squared_step = 0.0;
  double squared_position = 0.0;  // before the step
};

}  // namespace mgsfm

// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include "base/cpu_features.h"

namespace mgsfm {

constexpr double kMinDamping = 1e-6;
constexpr double kMaxDamping = 1e32;

MGSFM_ALWAYS_INLINE double ClampDiagonal(double value) {
  return value < kMinDamping ? kMinDamping
                             : (value > kMaxDamping ? kMaxDamping : value);
}

// Sums over the unknowns of a chunk that were eliminated: points and scales.
struct StepSums {
  double cost = 0.0;              // of the new state
  double decrease = 0.0;          // lambda d^T D d - g^T d
  double lost = 0.0;              // what bounds take away of that
  double squared_step = 0.0;      // of the unknowns
  double squared_position = 0.0;  // of them, before
};

}  // namespace mgsfm

// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <optional>
#include <vector>

#include "mgsfm/base/mask.h"
#include "moving_objects/motion_candidates.h"

namespace mgsfm {

// Chooses one motion per step, or none: the problem of motion_continuity.h,
// solved by dynamic programming.
//
// The *margin* of a step is the rise of the total cost if another motion is
// chosen there, which differs by more than kDistinct tolerances, and all other
// steps are chosen anew. Costs are negative logarithms of probabilities, so
// exp(-margin) is the ratio of the two probabilities. If no motion is chosen,
// any motion is another one; without another motion, the margin is infinite.
// The velocity of a free distance that is not tried depends on the steps
// before, for which the margin is an approximation.
//
// Cost: the product of the numbers of candidates of two steps, for each step
// and each step within kMaxNumSkipped before, once for the choice and once for
// the margins.

struct ChosenMotion {
  Velocity velocity;
  Candidate candidate;

  bool HasDistance() const { return !candidate.free_direction.has_value(); }
};

struct MotionChoice {
  // Per step.
  std::vector<std::optional<ChosenMotion>> motions;
  std::vector<double> margins;

  double cost = 0.0;  // of all steps
};

// Steps that are not doubtful must have a motion if they have candidates.
[[nodiscard]] MotionChoice ChooseMotions(const Steps& steps,
                                         const Mask& is_doubtful);

// Bounds the cost, which is linear in it. Half or twice as many change no error
// (docs/results/constants.md).
inline constexpr size_t kMaxNumSkipped = 7;

}  // namespace mgsfm

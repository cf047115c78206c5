// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <optional>
#include <vector>

#include "mgsfm/base/mask.h"
#include "moving_objects/motion_candidates.h"

namespace mgsfm {

// Chooses one motion per step, or none, by dynamic programming.
//
// The *margin* of a step is the rise of the total cost if another motion is
// chosen there, which differs by more than twice the tolerance, and all other
// steps are chosen anew. Costs are negative logarithms of probabilities, so
// exp(-margin) is the ratio of the two probabilities. A candidate that differs
// from the chosen motion only in its distance is no other motion if its matches
// leave the distance open. If no motion is chosen, any motion is another one;
// without another motion, the margin is infinite. The velocity of a free
// distance that is not tried depends on the steps before, for which the margin
// is an approximation. A motion over several steps counts for the margin of the
// last one only. The steps within it cost as much as steps without a motion.
//
// Cost: the product of the numbers of candidates of two steps, once for the
// choice and once for the margins, for each pair of steps between which it
// costs less to leave out all motions than the best motions found.

struct ChosenMotion {
  Velocity velocity;
  Candidate candidate;
  // A step within a motion over several steps, before its last one.
  bool is_inside = false;

  bool HasDistance() const { return !candidate.free_direction.has_value(); }
};

// Per step.
using ChosenMotions = std::vector<std::optional<ChosenMotion>>;

struct MotionChoice {
  ChosenMotions motions;
  std::vector<double> margins;  // per step
  double cost = 0.0;            // of all steps
};

// Steps that are not doubtful must have a motion if they have candidates.
[[nodiscard]] MotionChoice ChooseMotions(const Steps& steps,
                                         const Mask& is_doubtful);

}  // namespace mgsfm

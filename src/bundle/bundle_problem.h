// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include "least_squares/rig_problem.h"

namespace mgsfm {

// Bundle adjustment without scene: keypoints, and no terms but priors.
using BundleProblem = RigProblem<PixelObservation>;
using BundleState = RigState;

}  // namespace mgsfm

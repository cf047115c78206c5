// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include "rig_solver/rig_problem.h"

namespace mgsfm {

// The rig problem of bundle adjustment: keypoints and priors, no other terms.
using BundleProblem = RigProblem<PixelObservation>;
using BundleState = RigState;

}  // namespace mgsfm

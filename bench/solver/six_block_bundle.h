// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include "least_squares/rig_problem.h"
#include "mgsfm/base/summary.h"

namespace mgsfm {

// The same bundle problem as most programs give it to Ceres: automatic
// derivatives and six parameter blocks for each observation (rotation and
// centre of the frame, rotation and translation of the sensor, point, camera).
// Here as a yardstick only. Cameras must be pinholes with four parameters, all
// held; throws Error if not. `seconds` gets the time of the solve alone.
SolveSummary SolveSixBlockBundle(const RigProblem<PixelObservation>& problem,
                                 int max_num_iterations,
                                 double function_tolerance, int num_threads,
                                 RigState* state, double* seconds);

}  // namespace mgsfm

// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include "mgsfm/base/solver.h"
#include "rig_solver/rig_problem.h"

namespace mgsfm {

// The bundle problem in the usual formulation for Ceres: automatic derivatives
// and six parameter blocks per observation (rotation and center of the frame,
// rotation and translation of the sensor, point, camera). For comparison only.
// Cameras must be pinholes with four fixed parameters; throws Error otherwise.
// `seconds` receives the time of the solve alone.
SolveSummary SolveSixBlockBundle(const RigProblem<PixelObservation>& problem,
                                 int max_num_iterations,
                                 double function_tolerance, int num_threads,
                                 RigState* state, double* seconds);

}  // namespace mgsfm

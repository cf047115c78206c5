// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include "rotation/rotation_problem.h"

namespace mgsfm {

// Starting values of the nodes, given the sensors. All edges between the same
// two nodes are merged to their geodesic median (by weight); the support of
// that is the sum over the edges within `max_error_rad` of it. The merged
// rotations are chained along a spanning forest of maximum support; the root of
// each tree gets the identity.
void InitializeNodes(const RotationProblem& problem, double max_error_rad,
                     RotationState* state);

}  // namespace mgsfm

// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include "mgsfm/base/context.h"
#include "rig_solver/rig_problem.h"
#include "rig_solver/rig_solver.h"

namespace mgsfm {

// The same problem for Ceres, with the same derivatives and parametrization:
// SPARSE_SCHUR with CHOLMOD, or SPARSE_NORMAL_CHOLESKY without points. A
// reference; results depend on the number of threads.
template <class R>
SolveSummary SolveByCeres(const RigProblem<typename R::Observation>& problem,
                          const RigSolverOptions& options,
                          int max_num_iterations, const Context& context,
                          RigState* state);

}  // namespace mgsfm

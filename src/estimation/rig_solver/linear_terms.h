// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <Eigen/Core>

#include "rig_solver/rig_problem.h"
#include "rig_solver/rig_structure.h"

namespace mgsfm {

// Linear terms and parameter priors of a problem. They have no loss.

double CostOfLinearTerms(const RigProblemBase& problem, const RigState& state);

// Adds J^T r, the diagonal of J^T J, and the blocks of J^T J that are in the
// pattern. `matrix`: the values of the Schur complement, at the positions of
// the pattern.
void AddLinearTerms(const RigProblemBase& problem,
                    const RigStructure& structure, const RigState& state,
                    Eigen::VectorXd* gradient, Eigen::VectorXd* diagonal,
                    double* matrix);

// y += J^T J x.
void MultiplyLinearTerms(const RigProblemBase& problem,
                         const RigStructure& structure,
                         const Eigen::VectorXd& x, Eigen::VectorXd* y);

}  // namespace mgsfm

// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <Eigen/Core>
#include <Eigen/SparseCore>

#include "least_squares/rig_problem.h"
#include "least_squares/rig_structure.h"

namespace mgsfm {

// The linear terms and the priors of a problem: few, without loss.

double CostOfLinearTerms(const RigProblemBase& problem, const RigState& state);

// Adds J^T r, the diagonal of J^T J, and J^T J as far as the pattern has it.
void AddLinearTerms(const RigProblemBase& problem,
                    const RigStructure& structure, const RigState& state,
                    Eigen::VectorXd* gradient, Eigen::VectorXd* diagonal,
                    Eigen::SparseMatrix<double>* matrix);

// y += J^T J x.
void MultiplyLinearTerms(const RigProblemBase& problem,
                         const RigStructure& structure,
                         const Eigen::VectorXd& x, Eigen::VectorXd* y);

}  // namespace mgsfm

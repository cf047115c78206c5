// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <Eigen/Core>

#include "soft_rig/rig_scores.h"

namespace mgsfm {

// The inverse of an information matrix: huge where there is none.
Eigen::MatrixXd InvertInformation(Eigen::MatrixXd information);

// The change of the columns by a step of least squares.
Eigen::VectorXd NewtonStep(const RigScores& scores);

// The covariance of the columns: a jackknife that leaves out one block of
// frames at a time, so that also blocks of great influence count.
Eigen::MatrixXd Jackknife(const RigScores& scores);

// The covariance of the columns by that of the sum of all scores.
Eigen::MatrixXd CovarianceBy(const Eigen::MatrixXd& noise,
                             const RigScores& scores);

// Whether the two-sided probability of Student's t is below 1 in 10,000, with
// one degree of freedom less than blocks.
bool IsCertain(double t, Eigen::Index num_blocks);

}  // namespace mgsfm

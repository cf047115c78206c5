// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <Eigen/Core>

#include "rig_solver/rig_problem.h"
#include "rig_solver/rig_structure.h"

namespace mgsfm {

// The residual of a prior and its derivatives with respect to its frame and
// sensor. Only the first `size` rows are used.
struct PosePriorResidual {
  int size = 0;
  PoseVector value = PoseVector::Zero();
  PoseMatrix by_frame = PoseMatrix::Zero();
  PoseMatrix by_sensor = PoseMatrix::Zero();
};

// `motion` is that of the image of the prior since its frame.
PosePriorResidual EvaluatePositionPrior(const PositionPrior& prior,
                                        const FramePose& frame,
                                        const RigMotion& motion,
                                        const Rigid3& sensor_from_rig);
PosePriorResidual EvaluateGravityPrior(const GravityPrior& prior,
                                       const FramePose& frame,
                                       const RigMotion& motion,
                                       const Rigid3& sensor_from_rig);
PosePriorResidual EvaluateSensorPrior(const SensorPrior& prior,
                                      const Rigid3& sensor_from_rig);

// The functions below cover all position, gravity and sensor priors of a
// problem.

double CostOfPosePriors(const RigProblemBase& problem, const RigState& state);

// Adds J^T W r, the diagonal of J^T W J, and the blocks of J^T W J that are in
// the pattern. `matrix`: the values of the Schur complement, at the positions
// of the pattern.
void AddPosePriors(const RigProblemBase& problem, const RigStructure& structure,
                   const RigState& state, Eigen::VectorXd* gradient,
                   Eigen::VectorXd* diagonal, double* matrix);

// y += J^T W J x.
void MultiplyPosePriors(const RigProblemBase& problem,
                        const RigStructure& structure, const RigState& state,
                        const Eigen::VectorXd& x, Eigen::VectorXd* y);

}  // namespace mgsfm

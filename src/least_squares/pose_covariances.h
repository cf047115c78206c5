// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <Eigen/Core>
#include <optional>
#include <vector>

#include "least_squares/rig_problem.h"
#include "mgsfm/base/context.h"
#include "mgsfm/geometry/rigid3.h"

namespace mgsfm {

// Covariances of changes of poses (rig_problem.h), for residuals of variance
// one; zero for held coordinates. nullopt: the problem has no residual of it.
struct PoseCovariances {
  std::vector<std::optional<PoseMatrix>> frames;
  std::vector<std::optional<PoseMatrix>> sensors;
};

// The diagonal blocks of (J^T W J)^-1 at a state that minimises the cost, with
// points and parameters marginalised: blocks of the inverse of the reduced
// matrix, whose factor is solved for their columns. The problem must fix the
// gauge. The diagonal is raised by 1e-12 of itself, so that directions that no
// residual sees have huge variances instead of none. nullopt if a derivative is
// not finite or the factorisation fails all the same.
// Cost: one factorisation, and six solves for each pose.
template <class Observation>
[[nodiscard]] std::optional<PoseCovariances> ComputePoseCovariances(
    const RigProblem<Observation>& problem, const RigState& state,
    const Context& context);

// The same for groups of sensors, with the covariances between the sensors of a
// group: square matrices of 6 times its size. Zero for sensors without
// residuals, too.
template <class Observation>
[[nodiscard]] std::optional<std::vector<Eigen::MatrixXd>>
ComputeSensorCovariances(const RigProblem<Observation>& problem,
                         const RigState& state,
                         const std::vector<std::vector<int>>& groups,
                         const Context& context);

// Variances of the free parameters of each camera alone, likewise; empty for
// cameras without. Cost: one factorisation, and a solve for each.
template <class Observation>
[[nodiscard]] std::optional<std::vector<std::vector<double>>>
ComputeParameterVariances(const RigProblem<Observation>& problem,
                          const RigState& state, const Context& context);

}  // namespace mgsfm

// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <Eigen/Core>
#include <optional>
#include <vector>

#include "geometry/so3.h"
#include "mgsfm/base/context.h"
#include "mgsfm/geometry/rigid3.h"
#include "rig_solver/rig_problem.h"

namespace mgsfm {

// Relative to the diagonal; far below any observable curvature.
inline constexpr double kCovarianceDamping = 1e-12;

// Above this standard deviation, the linearization of a rotation is
// meaningless.
inline constexpr double kMaxSigmaRad = DegToRad(10.0);

// Covariances of pose changes (rig_problem.h) for residuals of unit variance.
// Zero for constant coordinates, nullopt for poses without residuals.
struct PoseCovariances {
  std::vector<std::optional<PoseMatrix>> frames;
  std::vector<std::optional<PoseMatrix>> sensors;
};

// The diagonal blocks of (J^T W J)^-1 at a minimum, with points and intrinsics
// marginalized: blocks of the inverse of the Schur complement. The problem must
// fix the gauge. The diagonal is increased by a factor of 1 + 1e-12, so
// directions without residuals get huge variances. nullopt if a derivative is
// not finite or the factorization fails. Cost: one factorization, and six
// triangular solves per pose.
[[nodiscard]] std::optional<PoseCovariances> ComputePoseCovariances(
    const RigProblem<PixelObservation>& problem, const RigState& state,
    const Context& context);

// The same for groups of sensors, including the covariances between the sensors
// of a group: 6 rows and columns per sensor, zero for sensors without
// residuals.
[[nodiscard]] std::optional<std::vector<Eigen::MatrixXd>>
ComputeSensorCovariances(const RigProblem<PixelObservation>& problem,
                         const RigState& state,
                         const std::vector<std::vector<int>>& groups,
                         const Context& context);

// The same for groups of frames: 6 rows and columns per frame, zero for
// constant coordinates.
[[nodiscard]] std::optional<std::vector<Eigen::MatrixXd>>
ComputeFrameCovariances(const RigProblem<PixelObservation>& problem,
                        const RigState& state,
                        const std::vector<std::vector<int>>& groups,
                        const Context& context);

// Variances of the free parameters of each camera; empty for cameras without
// free parameters. Cost: one factorization, and one triangular solve per
// parameter.
[[nodiscard]] std::optional<std::vector<std::vector<double>>>
ComputeParameterVariances(const RigProblem<PixelObservation>& problem,
                          const RigState& state, const Context& context);

}  // namespace mgsfm

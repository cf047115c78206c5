// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <Eigen/Core>
#include <optional>
#include <string>

#include "mgsfm/geometry/rigid3.h"
#include "mgsfm/scene/scene.h"

namespace mgsfm {

// Checks of all values that come from a file or go into one. They return the
// reason why a value cannot be right, as in "is not finite", or nullopt.

// Coordinates may be up to 1e15: there, a double resolves no tenth of a unit.
std::optional<std::string> WhyImplausible(
    const Eigen::Ref<const Eigen::VectorXd>& coordinates);
// A pose has a unit quaternion.
std::optional<std::string> WhyImplausible(const Rigid3& pose);

// The pose that a file holds with a few digits: normalizes a quaternion that is
// of unit length up to rounding. Any other stays as it is, so that
// WhyImplausible refuses it.
Rigid3 PoseOfFile(const Eigen::Quaterniond& rotation,
                  const Eigen::Vector3d& translation);
// How two values of one pose differ by more than the rounding to three digits
// in a matrix, as in "by 120 deg and by 0.2 (0.3 0 0, not 0.1 0 0)".
std::optional<std::string> WhyDifferent(const Rigid3& pose,
                                        const Rigid3& expected);

// A camera has a positive size and positive focal lengths.
std::optional<std::string> WhyImplausible(const Camera& camera);

// Why the known poses in rigs cannot be in meters: rigs on ships and trucks are
// shorter than the bound, and baselines in millimeters exceed it. nullopt if
// they may be.
std::optional<std::string> WhyRigsAreNotMetric(const Scene& scene);

}  // namespace mgsfm

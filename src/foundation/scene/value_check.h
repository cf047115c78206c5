// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <Eigen/Core>
#include <optional>
#include <string>

#include "mgsfm/geometry/rigid3.h"
#include "mgsfm/scene/scene.h"

namespace mgsfm {

// Checks of all values that are read from or written to a file. They return the
// reason why a value is invalid, as in "is not finite", or nullopt.

// Coordinates may be up to 1e15, where doubles are more than 0.1 apart.
std::optional<std::string> WhyImplausible(
    const Eigen::Ref<const Eigen::VectorXd>& coordinates);
// A pose must have a unit quaternion.
std::optional<std::string> WhyImplausible(const Rigid3& pose);

// A pose read with few digits: normalizes a quaternion that has unit length up
// to rounding. Any other is returned unchanged, so that WhyImplausible rejects
// it.
Rigid3 PoseOfFile(const Eigen::Quaterniond& rotation,
                  const Eigen::Vector3d& translation);
// How two values of one pose differ by more than rounding a matrix to three
// digits, as in "by 120 deg and by 0.2 (0.3 0 0, not 0.1 0 0)".
std::optional<std::string> WhyDifferent(const Rigid3& pose,
                                        const Rigid3& expected);

// A camera must have a positive size and positive focal lengths.
std::optional<std::string> WhyImplausible(const Camera& camera);

// Why the known poses in rigs cannot be in meters: rigs on ships and trucks are
// shorter than the bound, and baselines in millimeters exceed it. nullopt if
// they may be.
std::optional<std::string> WhyRigsAreNotMetric(const Scene& scene);

}  // namespace mgsfm

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
// A camera has a positive size and positive focal lengths.
std::optional<std::string> WhyImplausible(const Camera& camera);

}  // namespace mgsfm

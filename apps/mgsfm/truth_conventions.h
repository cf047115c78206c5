// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <optional>
#include <string>

#include "truth_comparison.h"

namespace mgsfm {

// The convention of poses by which the truth agrees with the rotations of the
// model from image to image, if it does not as it was read: other orders of
// quaternions, and inverse poses. nullopt if there is none.
std::optional<std::string> FindOtherConvention(
    const TruthComparison& comparison, TruthFormat format);

}  // namespace mgsfm

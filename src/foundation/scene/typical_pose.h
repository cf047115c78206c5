// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <vector>

#include "mgsfm/geometry/rigid3.h"

namespace mgsfm {

// A robust average of several estimates of one pose: the rotation with the
// smallest sum of angles to the others, and the coordinate-wise median of the
// translations. The rotation uses an evenly spaced subset of at most 200 poses,
// which bounds the cost to 200^2 angles. `poses` must not be empty.
Rigid3 TypicalPose(const std::vector<Rigid3>& poses);

}  // namespace mgsfm

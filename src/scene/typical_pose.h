// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <vector>

#include "mgsfm/geometry/rigid3.h"

namespace mgsfm {

// The pose that most of several estimates of one pose agree with: the rotation
// with the least sum of angles to the others, and the medians of the
// coordinates of the translations. Of more than 200 poses, every so many-th has
// a say in the rotation. At least one pose is needed.
Rigid3 TypicalPose(const std::vector<Rigid3>& poses);

}  // namespace mgsfm

// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <vector>

#include "mgsfm/input_check/finding.h"
#include "mgsfm/scene/scene.h"

namespace mgsfm {

// Images whose keypoints do not fit the size of their camera (kWrongImageSize):
// the largest coordinates of the keypoints of many images are either beyond the
// size, or the same small fraction of width and height.
std::vector<Finding> CheckImageSizes(const Scene& scene);

}  // namespace mgsfm

// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <cstddef>
#include <vector>

#include "mgsfm/input_check/finding.h"
#include "mgsfm/scene/estimates.h"
#include "mgsfm/scene/scene.h"

namespace mgsfm {

// Tests whether the rig of a model stands still (kRestingRig): nearly all
// points keep their places in the images of a camera. Either the rig did not
// move, or the images show only objects that move along with it.
//
// Each observation is compared with the first one of its point and sensor. Two
// keypoints of one sensor can belong to one projection if they differ by at
// most twice `max_error_px`, the outlier bound of bundle adjustment. The first
// observations of further sensors count as moving, so that a few points that
// single cameras see do not decide.
//
// Cost: linear in the observations, but for the logarithm of the sensors.
std::vector<Finding> FindRestingRig(const Scene& scene, size_t model_idx,
                                    const Reconstruction& model,
                                    double max_error_px);

}  // namespace mgsfm

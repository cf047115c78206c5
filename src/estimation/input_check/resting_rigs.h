// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <cstddef>
#include <vector>

#include "mgsfm/input_check/finding.h"
#include "mgsfm/scene/estimates.h"
#include "mgsfm/scene/scene.h"

namespace mgsfm {

// A model whose rig stands still (kRestingRig): nearly every point keeps its
// place in the images of a camera. Either the rig did not move, or the images
// show only objects that move along with it.
//
// Two keypoints of one sensor can belong to one projection if they differ by at
// most twice `max_error_px`, the outlier bound of bundle adjustment. Each
// observation is compared with the first of its point and sensor.
//
// Cost: linear in the observations.
std::vector<Finding> FindRestingRig(const Scene& scene, size_t model_idx,
                                    const Reconstruction& model,
                                    double max_error_px);

}  // namespace mgsfm

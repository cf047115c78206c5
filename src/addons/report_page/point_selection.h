// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <Eigen/Geometry>
#include <cstdint>
#include <vector>

#include "mgsfm/scene/estimates.h"

namespace mgsfm {

// The part of space that the page shows: it holds all but the most extreme
// points and frames, so that single outliers do not determine the scale.
Eigen::AlignedBox3d ShownBox(const Reconstruction& reconstruction);

// Indices of the points in the box, at most `max_points`, by descending
// importance; each prefix represents the cloud (see report_page.h).
std::vector<size_t> SelectPoints(const Reconstruction& reconstruction,
                                 const Eigen::AlignedBox3d& box,
                                 size_t max_points);

}  // namespace mgsfm

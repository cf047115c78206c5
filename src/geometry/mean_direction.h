// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <Eigen/Core>
#include <vector>

namespace mgsfm {

// The unit vector m that minimises sum_i min(angle(m, v_i), a) over unit
// vectors v_i, of which less than half may be anything. a: three medians of the
// angles, at least 1e-6. It starts at the sample (of up to 100, evenly spread)
// with the least median angle to all; re-weighted means follow until m moves by
// less than 1e-9, or 50 times. Must not be empty. O(samples) for each start and
// mean.
Eigen::Vector3d RobustMeanDirection(
    const std::vector<Eigen::Vector3d>& directions);

}  // namespace mgsfm

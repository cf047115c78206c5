// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <Eigen/Core>
#include <vector>

namespace mgsfm {

// A robust mean direction: the unit vector m that minimizes sum_i min(angle(m,
// v_i), a) over unit vectors v_i with less than half outliers, where a is three
// times the median angle, at least 1e-6 rad. The initial m is the sample, of
// 100 evenly spaced ones, with the smallest median angle to all others. At most
// 50 reweighted means refine m until it moves by less than 1e-9. `v` must not
// be empty. O(samples) per initial candidate and per mean.
Eigen::Vector3d RobustMeanDirection(
    const std::vector<Eigen::Vector3d>& directions);

}  // namespace mgsfm

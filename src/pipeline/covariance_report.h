// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <string>

#include "mgsfm/bundle/uncertainty.h"
#include "mgsfm/scene/scene.h"

namespace mgsfm {

// A line of column names, then one line per sensor and frame with a covariance:
// kind (sensor or frame), name, the standard deviations of the rotation (deg)
// and the translation in the coordinates of mgsfm/bundle/uncertainty.h, the
// number of unobservable directions of both, and the upper triangle of the
// covariance, row by row (rad, unit of length).
std::string CovariancesToCsv(const Scene& scene,
                             const CovarianceResult& covariances);

// One sentence that names the unobservable directions of sensors, or "" if
// there are none.
std::string DescribeUnobservable(const Scene& scene,
                                 const CovarianceResult& covariances);

}  // namespace mgsfm

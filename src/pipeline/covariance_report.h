// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <string>

#include "mgsfm/bundle/covariance.h"
#include "mgsfm/scene/scene.h"

namespace mgsfm {

// One line for each sensor and frame with a covariance, after a line with the
// names of the columns: kind (sensor, frame), name, the standard deviations of
// turns (deg) and shifts about and along the axes of mgsfm/bundle/covariance.h,
// how many directions of turns and shifts are not observable, and the upper
// triangle of the covariance, row by row (rad, unit of length).
std::string CovariancesToCsv(const Scene& scene,
                             const CovarianceResult& covariances);

// What is not observable of sensors, in a sentence; "" if all is.
std::string DescribeUnobservable(const Scene& scene,
                                 const CovarianceResult& covariances);

}  // namespace mgsfm

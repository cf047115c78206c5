// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <string>

#include "mgsfm/bundle_adjustment/uncertainty.h"
#include "mgsfm/scene/estimates.h"
#include "mgsfm/scene/scene.h"

namespace mgsfm {

// A line of column names, then one line per sensor and frame with a covariance:
// kind (sensor or frame), name, the standard deviations of the rotation (deg)
// and the translation in the coordinates of
// mgsfm/bundle_adjustment/uncertainty.h, the number of unobservable directions
// of both, and the upper triangle of the covariance, row by row (rad, unit of
// length).
std::string CovariancesToCsv(const Scene& scene,
                             const CovarianceResult& covariances);

// Whether the covariances distinguish the center of a sensor from the center of
// the reference sensor: chance separates them this far in less than 1 of 10,000
// rigs. Otherwise, the translation is determined only if it is as certain as
// the frames, because the centers of some cameras coincide.
bool IsPlaceDetermined(const Reconstruction& model,
                       const CovarianceResult& covariances, int sensor_idx);

// One sentence that names the unobservable directions of sensors and the
// undetermined sensor positions, or "" if there are none.
std::string DescribeUnobservable(const Scene& scene,
                                 const Reconstruction& model,
                                 const CovarianceResult& covariances);

}  // namespace mgsfm

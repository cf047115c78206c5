// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <cstddef>
#include <optional>
#include <vector>

#include "mgsfm/scene/estimates.h"

namespace mgsfm {

size_t NumObservations(const std::vector<Point3D>& points);
inline size_t NumObservations(const Reconstruction& reconstruction) {
  return NumObservations(reconstruction.points);
}

// The observations of each point, as candidates for an adjustment.
ObservationGroups GroupTracks(const std::vector<Point3D>& points);

// The mean over the observations of all points with a known error; nullopt
// without such points.
std::optional<double> MeanReprojectionErrorPx(
    const Reconstruction& reconstruction);

}  // namespace mgsfm

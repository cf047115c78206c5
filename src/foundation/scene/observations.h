// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <cstddef>
#include <optional>
#include <vector>

#include "geometry/epipolar.h"
#include "mgsfm/scene/estimates.h"
#include "mgsfm/scene/scene.h"
#include "mgsfm/scene/view_graph.h"

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

// The rays of the matches of a pair whose keypoints both have one.
RayMatches RaysOf(const Bearings& bearings, const ImagePair& pair);

}  // namespace mgsfm

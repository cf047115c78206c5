// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <algorithm>
#include <vector>

#include "mgsfm/scene/estimates.h"

namespace mgsfm {

// Removes points with fewer than two observations: two rays determine a point.
inline void RemovePointsOfShortTracks(std::vector<Point3D>* points) {
  constexpr size_t kMinTrackLength = 2;
  points->erase(std::remove_if(points->begin(), points->end(),
                               [](const Point3D& point) {
                                 return point.track.size() < kMinTrackLength;
                               }),
                points->end());
}

}  // namespace mgsfm

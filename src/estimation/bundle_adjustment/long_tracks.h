// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <vector>

#include "mgsfm/scene/estimates.h"
#include "mgsfm/scene/scene.h"

namespace mgsfm {

// Moves points out of `points` and returns them. The points that the most
// frames observe remain.
//
// A point on a moving object agrees with a rigid scene in few frames only, but
// bends their poses until its errors are small. The errors tell after the poses
// are adjusted to points that many frames observe.
//
// Property: each set of images keeps the tracks that connect it with the other
// images, or num_per_cut of them. A track remains if it connects images in one
// of num_per_cut spanning forests; the first such forest gets these connections
// (Nagamochi and Ibaraki, 1992, for hypergraphs).
//
// Cost: log(num_per_cut) near-constant operations per observation.
[[nodiscard]] std::vector<Point3D> TakeShortTracks(
    const Scene& scene, size_t num_per_cut, std::vector<Point3D>* points);

}  // namespace mgsfm

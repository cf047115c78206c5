// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <cstddef>
#include <vector>

#include "mgsfm/scene/estimates.h"
#include "mgsfm/scene/scene.h"

namespace mgsfm {

struct LongTrackOptions {
  size_t num_per_cut;  // of images
  size_t num_per_image;
};

// Moves the points that few frames observe out of `points` and returns them.
// Both lists keep their order. Tracks must not be empty.
//
// A point on a moving object usually agrees with a rigid scene in a few frames
// only, but if it is adjusted, it bends their poses until its errors are small.
// Once the poses are adjusted to points that many frames observe, its errors
// reveal it.
//
// Points are visited by their number of frames, descending. A point remains if
// one of its images has fewer than num_per_image points, or if it connects
// images in one of num_per_cut spanning forests; the first such forest gets
// these connections.
//
// Property (of numbers of tracks, not of parallax): for each set of images, all
// tracks that connect it with the other images remain, or at least num_per_cut
// of them (the argument of Nagamochi and Ibaraki, 1992, for graphs).
//
// Cost: that of sorting the points, num_per_cut operations per image, and
// log(num_per_cut) near-constant operations per observation.
[[nodiscard]] std::vector<Point3D> TakeShortTracks(
    const Scene& scene, const LongTrackOptions& options,
    std::vector<Point3D>* points);

}  // namespace mgsfm

// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include "bundle/point_filters.h"
#include "mgsfm/scene/estimates.h"
#include "mgsfm/scene/scene.h"
#include "mgsfm/scene/tracks.h"

namespace mgsfm {

// Replaces the points by what the present poses make of the groups of
// `groups`. A group may hold keypoints of several points in space: as long
// as there is a point with enough observations in agreement, it is taken, with
// at most one observation of an image (the best), and the search goes on in
// the remaining ones. Candidates are the points that the group had before and
// robust triangulations of what remains; the one with the most observations
// within max_error_px wins, of those the one with the smaller squared error.
// This completes, merges, splits, re-triangulates and filters points at once.
// Accepted points satisfy all of `options`.
//
// Points without any observation in a group are kept and only filtered, so that
// no keypoint is in two points.
// Groups are treated independently and in parallel; the new points are in
// their order. Poses and intrinsics do not change.
void Retriangulate(const Scene& scene, const ObservationGroups& groups,
                   const PointFilterOptions& options, int num_threads,
                   Reconstruction* reconstruction);

}  // namespace mgsfm

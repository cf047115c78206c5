// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <Eigen/Core>
#include <vector>

#include "bundle_adjustment/point_filters.h"
#include "mgsfm/scene/estimates.h"
#include "mgsfm/scene/scene.h"

namespace mgsfm {

// Triangulates the points again from groups of keypoints, with the current
// poses. A group can contain keypoints of several points. Repeatedly, the best
// hypothesis becomes a point with at most one observation per image (the one
// with the smallest error), and the search continues in the remaining
// keypoints.
//
// Hypotheses are the previous points of the group and robust triangulations of
// the remaining keypoints. The best one has the most observations within
// max_error_px; ties are broken by the sum of squared errors. This completes,
// merges, splits, re-triangulates and filters points at once. All accepted
// points satisfy `options`.
//
// Points without an observation in a group are kept and filtered, so no
// keypoint belongs to two points. Groups are processed independently and in
// parallel; the new points are in the order of the groups. Poses and intrinsics
// do not change.
void Retriangulate(const Scene& scene, const ObservationGroups& groups,
                   const PointFilterOptions& options, int num_threads,
                   Reconstruction* reconstruction);

// The points of one group, those with the most observations first. `old_points`
// are the previous points of the group.
std::vector<Point3D> TriangulateGroup(
    const Scene& scene, const std::vector<ImageView>& views,
    const Observation* begin, const Observation* end,
    const std::vector<Eigen::Vector3d>& old_points,
    const PointFilterOptions& options);

}  // namespace mgsfm

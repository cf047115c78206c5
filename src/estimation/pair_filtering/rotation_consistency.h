// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include "mgsfm/base/mask.h"
#include "mgsfm/pair_filtering/pair_filtering.h"
#include "mgsfm/scene/estimates.h"
#include "mgsfm/scene/scene.h"
#include "mgsfm/scene/view_graph.h"
#include "pair_filtering/frame_pair_index.h"

namespace mgsfm {

// Pairs whose relative rotation contradicts the rotations of the skeletal graph
// alone by more than its drift explains. Duplicate structures are often only
// some degrees off; many of them break the trajectory at places that few
// correct pairs hold together.
//
// Let d be the angle between the relative rotation of a pair and that of the
// skeleton, sigma the robust standard deviation of all d per axis, and l the
// number of edges between the two frames along the skeleton. A pair outside the
// skeleton is inconsistent if
//
//   d > max_rotation_error + min(rotation_drift_in_sigmas * sigma * sqrt(l),
//                                max_rotation_drift):
//
// drift is modeled as a random walk with steps of standard deviation sigma.
// Pairs of frames that the skeleton does not connect are not judged. None is
// inconsistent if too many would be (pair_filtering.h).
// Per pair. Cost: a path through a tree for each pair.
[[nodiscard]] Mask FindInconsistentRotations(
    const PairEvidence& evidence, const Mask& is_in_skeleton,
    const RotationEstimate& by_skeleton);

}  // namespace mgsfm

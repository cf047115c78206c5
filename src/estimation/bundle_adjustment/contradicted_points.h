// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include "mgsfm/scene/estimates.h"
#include "mgsfm/scene/scene.h"
#include "mgsfm/scene/view_graph.h"

namespace mgsfm {

// Removes points that the matches of their own keypoints contradict.
//
// A match of an observation of point X with a keypoint x of another registered
// image contradicts X if |project(X) - x| > max_error_px there. With c such
// matches, the n observations of a point agree in n (n - 1) ordered pairs, and
// the share of its matches that agree is
//
//   n (n - 1) / (n (n - 1) + c).
//
// A feature of a vehicle that moves along with the rig is matched in many
// images. Two or three of them agree with a static point, by chance or because
// a frame that few tracks hold is bent towards them; all others contradict it.
// The residuals of the point are as small as those of right ones, so that no
// loss tells them apart. Wrong matches of right points are independent of each
// other, and longer tracks outweigh more of them.
//
// Cost: one pass over all matches.
void RemoveContradictedPoints(const Scene& scene, const ViewGraph& matches,
                              double max_error_px, double min_match_share,
                              int num_threads, Reconstruction* reconstruction);

}  // namespace mgsfm

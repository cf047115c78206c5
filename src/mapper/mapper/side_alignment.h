// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include "mapper/model_adjustment.h"
#include "mapper/weak_seams.h"
#include "mgsfm/base/context.h"
#include "mgsfm/base/mask.h"
#include "mgsfm/mapper/mapper.h"
#include "pair_filtering/frame_pair_index.h"

namespace mgsfm {

// Tests a model at its weak seams. Both sides of a seam are rigid, but few
// points tie them, and an object that moves can have decided their relative
// pose. The structure of either side cannot show such an object: two frames of
// the side observe its points.
//
// Problem: the pose of one side relative to the other that explains most
// matches of its keypoints with points of the other side, in both directions.
// Only matches of neighbors in time count, since places can look alike.
// Unknown: 6 parameters, by LO-RANSAC (geometry/absolute_pose.h). An inlier has
// the largest error of an observation in bundle adjustment.
//
// The pose replaces that of the model if it explains more matches,
//
//   n - m > 3 sqrt(n + m),  n >= min_num_inliers of the view graph,
//
// with n and m the matches that only one of them explains. Then the model is
// adjusted again with all pairs of the neighbors across the seam. It stays if
// significantly more points tie both sides; `input` then uses these pairs.
// Seams are tested by ascending confidence, until none changes.
//
// Cost: linear in the matches across each seam, and a bundle adjustment for
// each pose that explains more.
void RealignSides(const FramePairIndex& index, const MapperOptions& options,
                  const Context& context,
                  const ConfidenceFunction& confidence_of,
                  AdjustmentInput* input, MapperModel* model);

}  // namespace mgsfm

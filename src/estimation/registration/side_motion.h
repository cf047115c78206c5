// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <optional>

#include "mgsfm/base/context.h"
#include "mgsfm/base/mask.h"
#include "mgsfm/scene/estimates.h"
#include "mgsfm/scene/scene.h"
#include "mgsfm/scene/view_graph.h"

namespace mgsfm {

// Two sides of a model: the frames of a mask, and the others.
struct SidesInput {
  const Scene& scene;
  const Bearings& bearings;
  const ViewGraph& matches;  // of image pairs across
  const Reconstruction& model;
  const Mask& frame_is_beyond;
  double max_error_px;  // of an inlier
  int min_num_inliers;

  bool IsBeyond(int image_idx) const {
    return frame_is_beyond[scene.images[image_idx].frame_idx];
  }
};

// beyond_from_core, the motion of the side beyond that explains more matches
// than the model, if there is one. Both sides are rigid.
//
// Problem: the pose of one side relative to the other that explains most
// matches of its keypoints with points of the other side, in both directions.
// Unknown: 6 parameters, by LO-RANSAC (geometry/absolute_pose.h). The pose
// replaces that of the model if it explains more matches,
//
//   n - m > 3 sqrt(n + m),  n >= min_num_inliers,
//
// with n and m the matches that only one of them explains. Cost: linear in the
// matches.
[[nodiscard]] std::optional<Rigid3> FindMotionOfSide(const SidesInput& input,
                                                     const Context& context);

// Whether a count exceeds another beyond the noise of both.
[[nodiscard]] bool IsSignificantlyMore(int count, int other);

}  // namespace mgsfm

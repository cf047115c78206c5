// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <optional>
#include <vector>

#include "mgsfm/base/context.h"
#include "mgsfm/base/mask.h"
#include "mgsfm/pair_filtering/pair_filtering.h"
#include "mgsfm/scene/estimates.h"
#include "mgsfm/scene/scene.h"
#include "mgsfm/scene/view_graph.h"
#include "pair_filtering/frame_pair_index.h"

namespace mgsfm {

// What moves along with the rig in a sequence. All empty if nothing does.
struct MovingObjects {
  // Per pair of the view graph: its matches follow an object.
  Mask pair_is_on_object;
  // Per image and keypoint: it shows an object. Empty for images without any.
  std::vector<Mask> keypoint_is_moving;
  // Per pair next to an object: the length of its baseline by matches that
  // agree with the motion, in an arbitrary unit.
  std::vector<std::optional<double>> length_of_pair;
};

// Finds the pairs that contradict the motion of the rig
// (pair_filtering/motion_continuity.h), and keypoints on the objects they
// follow:
//
//   baselines   directions of pairs by their own rotations: averaged ones,
//               `rotations`, may have followed an object
//   depths      of keypoints by pairs within a frame, whose baselines have the
//               same length in all frames
//   lengths     of the baselines between frames: each keypoint with a depth
//               votes. Matches on an object vote for another length than those
//               of the world
//   motion      the smoothest sequence of baselines
//   keypoints   next to an object, those whose votes contradict the motion more
//               often than not
//
// Cameras without overlap give no depths; lengths are then those of scale
// averaging (translation/scale_averaging.h), and keypoints are not judged.
MovingObjects FindMovingObjects(const Scene& scene, const Bearings& bearings,
                                const FramePairIndex& index,
                                const ViewGraph& view_graph,
                                const RotationEstimate& rotations,
                                double min_parallax_deg,
                                const PairFilteringOptions& filtering,
                                const Context& context);

// Removes the matches of moving keypoints, and the relative poses of pairs that
// had no others.
void RemoveMovingKeypoints(const MovingObjects& objects, ViewGraph* view_graph);

}  // namespace mgsfm

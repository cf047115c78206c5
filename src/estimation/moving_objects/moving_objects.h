// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <optional>
#include <vector>

#include "mgsfm/base/context.h"
#include "mgsfm/base/mask.h"
#include "mgsfm/pair_filtering/pair_filtering.h"
#include "mgsfm/scene/view_graph.h"
#include "mgsfm/view_graph/view_graph_estimation.h"
#include "moving_objects/frame_depths.h"

namespace mgsfm {

struct MotionOptions {
  double min_parallax_deg;
  const ViewGraphOptions& verification;
  const PairFilteringOptions& filtering;
};

// The motion of the static scene relative to the rig in a sequence whose
// matches also support other motions. Everything is empty if none do.
struct MotionOfScene {
  // Per pair of the view graph: rejected if its matches do not show the static
  // scene, or if its motion is ambiguous.
  PairVerdicts verdicts;
  // Per pair: its matches on the static scene and the relative pose that they
  // imply, if both are known.
  std::vector<std::optional<ImagePair>> pair_of_scene;
  // cam2_from_cam1 on the path for pairs near an object, if the path determines
  // the length of the baseline, and the relative poses of pairs within frames,
  // in one unit of length.
  std::vector<std::optional<Rigid3>> pair_on_path;
  // Per frame: whether the motion from or to it is unknown, because an object
  // explains it as well as the static scene.
  Mask frame_is_ambiguous;
};

// Decides for neighbors in a sequence which matches show the static scene:
//
//   depths      of keypoints by pairs within frames (frame_depths.h)
//   motions     of the rig between frames that the matches support
//               (motion_hypotheses.h)
//   path        the smoothest choice (moving_objects/motion_continuity.h)
//   pairs       of neighbors (pair_filtering/frame_pair_index.h), where
//               motions compete, or near: matches that agree with the path, by
//               the epipolar constraint and by their depths, determine the
//               relative pose anew. Pairs without enough of them are
//               discontinuous; those across a step whose motion is ambiguous
//               have none.
//
// `matches` is the view graph before estimation: where a vehicle dominates an
// image, matches of the static scene are outliers of its pairs.
//
// Rigs without overlapping views have no depths, and depths that contradict the
// image pairs (motion_candidates.h) are not used. Motions are then those of
// their pairs, with the rotations of the pairs and lengths from scale
// averaging, and pairs are judged by their own poses.
[[nodiscard]] MotionOfScene FindMovingObjects(const MotionInput& input,
                                              const MotionOptions& options,
                                              const Context& context);

}  // namespace mgsfm

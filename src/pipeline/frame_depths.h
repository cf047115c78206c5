// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include "mgsfm/base/context.h"
#include "mgsfm/scene/estimates.h"
#include "mgsfm/scene/scene.h"
#include "mgsfm/scene/view_graph.h"
#include "pair_filtering/frame_pair_index.h"
#include "pair_filtering/rig_motions.h"

namespace mgsfm {

// Depths of keypoints by pairs within frames, whose baselines have the same
// length in all frames (links of scale averaging,
// translation/scale_averaging.h) and the centres of the sensors that these
// pairs connect. The unit of length is arbitrary; the origin of a rig is one of
// these sensors. Pairs are measured with their own rotations. `noise_px` is the
// standard deviation of keypoints, from which those of the distances follow.
// Without overlapping views nothing is known.
[[nodiscard]] FrameDepths MeasureFrameDepths(
    const Scene& scene, const Bearings& bearings, const FramePairIndex& index,
    const ViewGraph& view_graph, const RotationEstimate& rotations,
    double min_parallax_deg, double noise_px, const Context& context);

}  // namespace mgsfm

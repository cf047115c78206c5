// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <vector>

#include "mgsfm/base/context.h"
#include "mgsfm/base/mask.h"
#include "mgsfm/scene/scene.h"
#include "mgsfm/scene/view_graph.h"
#include "pair_filtering/frame_pair_index.h"

namespace mgsfm {

// Objects that move along with the rig during the whole recording: the hull of
// a boat, a cabin, a tripod, the hand or the operator who carries it.
//
// Their matches keep their ray in the camera while the rig turns, and state
// that it stands still. Where they are many, verification and averaging follow
// them.
//
// The rig turns between two frames if a pair of images of these frames has a
// rotation by which a point at infinity moves visibly; in a sequence, also if
// the pairs of one of them with a frame next to the other do, as pairs of the
// object itself have no rotation. On a straight way, distant points keep their
// rays, too. There, the parallax of matches within frames tells how near points
// are; points that move tell how far the rig went; and a match that keeps its
// ray counts if its point is so near that it would move visibly at rest.
//
// Images are divided into cells. Each pair of images of one sensor votes once
// per cell: fixed, if more matches there keep their ray than do not. A cell is
// fixed if the lower confidence bound of the share of its votes is high, so
// that vehicles which stay at a constant distance for a part of the recording
// are no such objects.
//
// Limits. If nothing else is visible, nothing is found. Without cameras that
// overlap, the rig must turn.
struct FixedRegions {
  // A cell is a thirtieth of the width of a wide image: about as large as the
  // largest keypoints.
  static constexpr int kNumColumns = 32;
  static constexpr int kNumRows = 24;
  std::vector<Mask> of_sensor;  // cells, row by row; empty: none is fixed

  bool Contains(const Scene& scene, int image_idx, size_t keypoint_idx) const;
  bool Any() const;
  // The fraction of the image of a sensor.
  double FractionOf(int sensor_idx) const;
};

// `view_graph` has relative poses, and `max_error_px` is their tolerance. Cost:
// linear in the matches.
[[nodiscard]] FixedRegions FindFixedRegions(const Scene& scene,
                                            const Bearings& bearings,
                                            const FramePairIndex& index,
                                            const ViewGraph& view_graph,
                                            double max_error_px);

// The view graph without matches of keypoints in fixed regions. The log states
// for each sensor how much of its images is fixed.
[[nodiscard]] ViewGraph DropFixedRegions(const Scene& scene,
                                         const FixedRegions& regions,
                                         const ViewGraph& view_graph,
                                         const Context& context);

}  // namespace mgsfm

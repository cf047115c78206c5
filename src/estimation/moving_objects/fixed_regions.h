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
// The rays of their matches do not change while the rig turns, so these matches
// imply that it stands still. Many such matches mislead verification and
// averaging.
//
// The rig turns between two frames if a pair of their images has a rotation
// that visibly moves a point at infinity. In a sequence, it also turns if pairs
// of one frame with a frame next to the other rotate, because pairs on the
// object itself have no rotation. On a straight path, the rays of distant
// points do not change, either. There, the parallax of matches within frames
// measures how near points are, and moving points measure how far the rig went.
// A match with a constant ray counts if its point is so near that a static
// point would move visibly.
//
// Images are divided into cells. Each pair of images of one sensor votes once
// per cell: fixed, if most rays of its matches there are constant. A cell is
// fixed if the lower confidence bound of the fraction of such votes is high,
// which excludes vehicles that stay at a constant distance for only part of the
// recording.
//
// Found regions expose the scenery: pairs that the object won are verified anew
// without them, show that the rig turns, and reveal further cells. The caller
// repeats the search until it adds none.
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
  // Adds the cells of others. Returns whether any is new.
  bool Add(const FixedRegions& others);
  // The fraction of the image of a sensor.
  double FractionOf(int sensor_idx) const;
};

// `view_graph` must have relative poses; `max_error_px` is their tolerance.
// Cost: linear in the matches.
[[nodiscard]] FixedRegions FindFixedRegions(const Scene& scene,
                                            const Bearings& bearings,
                                            const FramePairIndex& index,
                                            const ViewGraph& view_graph,
                                            double max_error_px);

// The view graph without matches of keypoints in fixed regions.
[[nodiscard]] ViewGraph DropFixedRegions(const Scene& scene,
                                         const FixedRegions& regions,
                                         const ViewGraph& view_graph);

// Logs the fixed fraction of the images of each sensor.
void LogFixedRegions(const Scene& scene, const FixedRegions& regions,
                     const Context& context);

}  // namespace mgsfm

// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include "mgsfm/scene/scene.h"
#include "mgsfm/scene/view_graph.h"

namespace mgsfm {

// Compares given poses of sensors with the relative poses of image pairs, and
// throws Error, naming both sensors, if these contradict each other:
// - the relative rotation of two sensors within a frame, by more than 10
//   degrees in three quarters of at least 5 frames;
// - its direction of translation likewise, by more than 45 degrees from the
//   mean of the measured directions, if these agree among each other (their
//   mean is longer than 0.9);
// - the turns of two sensors from one frame to another, of at least 5 degrees,
//   by more than half of the turn in three quarters of at least 10 frame pairs.
// A rig that the images cannot tell of passes. Linear in the number of pairs,
// but for sorting.
void CheckKnownRigs(const Scene& scene, const ViewGraph& view_graph);

}  // namespace mgsfm

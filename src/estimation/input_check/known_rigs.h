// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include "mgsfm/scene/scene.h"
#include "mgsfm/scene/view_graph.h"

namespace mgsfm {

struct MatchedPairs {
  const Bearings& bearings;
  const ViewGraph& view_graph;
};

// Compares the known poses of sensors in their rigs with image pairs. Throws
// Error, naming both sensors, if two known poses contradict
// - in three quarters of the frames, the rotation on which the pairs between
//   both sensors agree (rig_samples.h);
// - in three quarters of the frames, most matches between both sensors,
//   whatever small rotation corrects the known one, where another direction of
//   the translation explains them;
// - the rotation that the motions of both sensors determine
//   (camera_motions.h), which need no common field of view.
// The bounds separate gross mistakes, such as an inverted pose, from an
// inaccurate calibration, which the mapper accepts. A rig that the images do
// not constrain passes. If the poses agree in another convention, the error
// says so.
void CheckKnownRigs(const Scene& scene, const MatchedPairs& pairs);

}  // namespace mgsfm

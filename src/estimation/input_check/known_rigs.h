// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include "mgsfm/scene/scene.h"
#include "mgsfm/scene/view_graph.h"

namespace mgsfm {

// Compares the known poses of sensors in their rigs with image pairs. Throws
// Error, naming both sensors, if two known poses contradict
// - in three quarters of the frames, the rotation, or the direction of the
//   translation, on which the pairs between both sensors agree (rig_samples.h);
// - the rotation that the motions of both sensors determine
//   (camera_motions.h), which need no common field of view.
// The bounds separate gross mistakes, such as an inverted pose, from an
// inaccurate calibration, which the mapper accepts. A rig that the images do
// not constrain passes. If the poses agree in another convention, the error
// says so.
void CheckKnownRigs(const Scene& scene, const ViewGraph& view_graph);

}  // namespace mgsfm

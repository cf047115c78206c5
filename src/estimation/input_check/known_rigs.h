// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include "mgsfm/scene/scene.h"
#include "mgsfm/scene/view_graph.h"

namespace mgsfm {

// Compares the known poses of sensors in their rigs with the relative poses of
// image pairs. Throws Error, naming both sensors, if they contradict:
// - the relative rotation of two sensors within a frame differs by more than 10
//   degrees in three quarters of at least 5 frames;
// - the direction of their relative translation differs by more than 45 degrees
//   from the mean of at least 5 measurements that agree (the mean of the unit
//   vectors is longer than 0.9);
// - the rotations of two sensors between the same two frames, of at least 5
//   degrees, differ by more than half of the rotation in three quarters of at
//   least 10 pairs of frames. Half of the rotations must have equal angles,
//   which those of wrong pairs do not have; others are not compared.
// A rig that the images do not constrain passes. Cost: linear in the number of
// pairs, except for sorting.
void CheckKnownRigs(const Scene& scene, const ViewGraph& view_graph);

}  // namespace mgsfm

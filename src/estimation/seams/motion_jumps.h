// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <optional>
#include <utility>
#include <vector>

#include "mgsfm/scene/estimates.h"
#include "mgsfm/scene/scene.h"
#include "mgsfm/scene/view_graph.h"
#include "pair_filtering/frame_pair_index.h"

namespace mgsfm {

// Pairs of frames of one sequence. Errors are the differences of baselines from
// the expected ones, in length and direction.
struct ComparedMotions {
  // The median error, relative to the longer baseline, if the model has most
  // frames of the scene. In a small model, all pairs can be wrong.
  double typical_error = 0.0;
  // The error exceeds half of the longer baseline and a typical step, and the
  // model does not connect the nearest confirmed pairs more smoothly than the
  // expected motion. Empty if the expected motions are refuted.
  std::vector<std::pair<int, int>> jumps;
  // The error is at most 20 % of the longer baseline.
  std::vector<std::pair<int, int>> confirmed;

  // The model has most frames, and the typical error is above 20 %: pairs over
  // many frames determine the model, single steps the expected motions.
  bool AreRefuted() const;
};

// Compares a model with the motion of the rig. Few correct pairs across a cut
// may not determine the distance, so that a wrong pair decides it. Pairs on a
// vehicle alongside turn the direction.
//
// `expected` per pair of the view graph: cam2_from_cam1, in one unit of length.
// Baselines within frames provide this unit in the model, because a small model
// can contradict most steps. Without them, the unit is the median ratio of step
// lengths. For image pairs of equal sensors, the median counts. A rig does not
// stop or turn from one frame to the next: where both motions differ, the
// smoother one is correct. The expected motion, too, may come from an object
// that moves along with the rig. `max_relative_error` is the bound on the
// baselines of pairs (pair_filtering.h). Empty without expected poses. Cost:
// linear in the pairs, and in the jumps times the confirmed pairs.
[[nodiscard]] ComparedMotions CompareMotions(
    const Scene& scene, const FramePairIndex& index,
    const ViewGraph& view_graph,
    const std::vector<std::optional<Rigid3>>& expected,
    const Reconstruction& reconstruction, double max_relative_error);

}  // namespace mgsfm

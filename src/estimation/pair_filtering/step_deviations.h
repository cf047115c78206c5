// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <Eigen/Core>
#include <optional>
#include <vector>

#include "mgsfm/scene/scene.h"
#include "mgsfm/scene/view_graph.h"
#include "pair_filtering/frame_pair_index.h"

namespace mgsfm {

// Steps of a sequence that nearly all pairs of neighbors contradict in the
// same way.
//
// Where few pairs of neighbors cross a step, many loop pairs outvote them: a
// robust loss puts the error of a loop where it costs least. Correct pairs of
// neighbors then agree that the step is wrong, and on what it should be.
//
// A pair i, j of neighbors across the step, with i before j, has a deviation
// e_ij of its measurement from the estimate, in world axes. All of them contain
// the error of the step. Their median e, coordinate by coordinate, is
// common to the pairs if |e_ij - e| < |e_ij| for 90 % of them: hardly any
// supports the step as it is.

// Per pair, from image 1 to image 2; nullopt for pairs that do not count.
using PairDeviations = std::vector<std::optional<Eigen::Vector3d>>;
// Per frame: the common deviation of the pairs across the step to it.
using StepDeviations = std::vector<std::optional<Eigen::Vector3d>>;

// Per frame: the one before it in its sequence; nullopt for the first.
[[nodiscard]] std::vector<std::optional<int>> PreviousFrames(
    const FramePairIndex& index);

// None without temporal order. Loops and pairs within a frame do not count.
// Cost: linear in the pairs of neighbors times their time gap.
[[nodiscard]] StepDeviations FindCommonDeviations(
    const Scene& scene, const FramePairIndex& index,
    const ViewGraph& view_graph, const PairDeviations& deviations);

}  // namespace mgsfm

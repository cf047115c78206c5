// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <optional>
#include <vector>

#include "mgsfm/base/mask.h"
#include "moving_objects/motion_candidates.h"
#include "moving_objects/motion_search.h"

namespace mgsfm {

// Motions between frames that are several steps of a sequence apart.
//
// A vehicle that leads the rig stays in view longer than the static scene.
// Consecutive frames may show the scene, and frames further apart the vehicle:
// its motion competes with the steps between them. Where the vehicle fills the
// views of consecutive frames, frames further apart may show the scene, as one
// of them sees past it.

// The steps within motions over kMaxNumSteps steps or fewer that compete with
// the composition of the chosen motions, if their distances are measured: they
// differ, have support, their
// matches exclude each other, and the motion that begins one step later is
// equal. None without `compare`, because the errors of many steps add up. Cost:
// that of the hypotheses, once for each number of steps.
[[nodiscard]] Mask FindLongRivals(
    const std::vector<int>& frame_idxs, const MotionEvidence& evidence,
    const Steps& steps, const std::vector<std::optional<ChosenMotion>>& chosen,
    int num_threads);

// Adds candidates for steps without a choice: the hypotheses between frames
// before and after them, at most kMaxNumSkipped + 1 steps apart, without the
// chosen motions of the other steps between these frames. Returns whether there
// are any.
bool AddLongMotions(const std::vector<int>& frame_idxs,
                    const MotionEvidence& evidence,
                    const std::vector<std::optional<ChosenMotion>>& chosen,
                    const Mask& is_doubtful, Steps* steps);

}  // namespace mgsfm

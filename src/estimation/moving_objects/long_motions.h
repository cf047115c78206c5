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
// If a vehicle fills the views of consecutive frames, their matches measure
// only the motion relative to the vehicle. Frames further apart may show the
// scene, as one of them sees past the vehicle.
//
// Adds candidates for steps without a choice: the hypotheses between frames at
// most kMaxNumSkipped + 1 steps apart, without the chosen motions of the steps
// before the first unknown step and after the last one, whose distances must be
// known. Returns whether there are any.
//
// Cost: that of the hypotheses, for each pair of frames around an unknown step.
bool AddLongMotions(const std::vector<int>& frame_idxs,
                    const MotionEvidence& evidence,
                    const std::vector<std::optional<ChosenMotion>>& chosen,
                    const Mask& is_doubtful, Steps* steps);

// Gives each step within a chosen motion over several steps the velocity of a
// uniform motion that leads to the end, and its part of the variance.
void DivideLongMotions(const std::vector<double>& durations,
                       std::vector<std::optional<ChosenMotion>>* chosen);

}  // namespace mgsfm

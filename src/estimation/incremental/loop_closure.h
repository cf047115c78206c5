// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <optional>
#include <vector>

#include "incremental/growing_model.h"

namespace mgsfm {

// The pose of a new frame, and what contradicts it.
struct FrameRegistration {
  std::optional<Rigid3> rig_from_world;
  int num_keypoints = 0;
  int num_inliers = 0;
  // Another pose on which the outliers agree, if other frames observe their
  // points: the model has drifted between these frames.
  struct Loop {
    Rigid3 rig_from_world;
    int num_inliers = 0;
    std::vector<int> frame_idxs;        // observe the points of this pose
    std::vector<int> other_frame_idxs;  // observe those of the other
  };
  std::optional<Loop> loop;
};

[[nodiscard]] FrameRegistration RegisterFrame(const GrowthInput& input,
                                              const GrowingModel& model,
                                              int frame_idx);

// Moves the frames of the loop by the motion between both poses of the frame.
// Returns whether the model now agrees with both poses; otherwise it has the
// poses from before.
bool CloseLoop(const GrowthInput& input, int frame_idx,
               const FrameRegistration& registration, GrowingModel* model);

}  // namespace mgsfm

// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <optional>
#include <vector>

#include "mgsfm/model_tools/model_tools.h"

namespace mgsfm {

// The items of the first model that items of the second are; nullopt for items
// that only the second has.
struct ModelUnion {
  std::vector<std::optional<int>> first_image;   // per image of the second
  std::vector<std::optional<int>> first_sensor;  // per sensor
  std::vector<std::optional<int>> first_rig;     // per rig
  std::vector<std::optional<int>> first_frame;   // per frame
};

// Throws Error if rigs, frames, cameras or keypoints contradict each other.
ModelUnion FindUnion(const SceneModel& first, const SceneModel& second);

}  // namespace mgsfm

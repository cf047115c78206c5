// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <cstdint>
#include <optional>
#include <string>
#include <vector>

#include "mgsfm/scene/scene.h"

namespace mgsfm {

// A scene of one rig and sensor whose frames have one image each. The frame of
// rank k in time has the index order[k], and k as its name.
inline Scene SingleImageFrames(const std::vector<int>& order) {
  Scene scene;
  scene.rigs.push_back({RigId(1), 0, {0}});
  scene.sensors.push_back({"", 0, 0, std::nullopt});
  const int size = static_cast<int>(order.size());
  for (int i = 0; i < size; ++i) {
    const auto id = static_cast<uint32_t>(i + 1);
    scene.images.push_back({ImageId(id), "", 0, 0, i, {}});
    scene.frames.push_back({FrameId(id), "", 0, {i}});
  }
  for (int k = 0; k < size; ++k) {
    scene.frames[order[k]].name = std::to_string(k);
  }
  return scene;
}

}  // namespace mgsfm

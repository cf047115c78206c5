// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <cstdio>
#include <functional>
#include <string>
#include <vector>

#include "mgsfm/scene/scene.h"

namespace mgsfm {

// One rig, images cam0/0000, cam0/0001, ..., cam1/0000, ... in the canonical
// order. Only images with `exists(sensor, frame)` are included; each frame
// needs at least one.
inline Scene MakeRigScene(
    int num_sensors, int num_frames,
    const std::function<bool(int, int)>& exists = [](int, int) {
      return true;
    }) {
  Scene scene;
  scene.rigs.push_back({RigId(1), 0, {}});
  scene.cameras.push_back({CameraId(1),
                           CameraModelId::kPinhole,
                           800,
                           600,
                           {600, 600, 400, 300},
                           true});
  std::vector<int> frame_idxs(num_frames, -1);
  for (int sensor = 0; sensor < num_sensors; ++sensor) {
    const std::string folder = "cam" + std::to_string(sensor);
    scene.sensors.push_back({folder, 0, 0, std::nullopt});
    scene.rigs[0].sensor_idxs.push_back(sensor);
    for (int i = 0; i < num_frames; ++i) {
      if (!exists(sensor, i)) continue;
      char frame_name[8];
      std::snprintf(frame_name, sizeof(frame_name), "%04d", i % 10000);
      if (frame_idxs[i] < 0) {
        frame_idxs[i] = static_cast<int>(scene.frames.size());
        scene.frames.push_back(
            {FrameId(static_cast<uint32_t>(i)), frame_name, 0, {}});
      }
      const int image_idx = static_cast<int>(scene.images.size());
      scene.frames[frame_idxs[i]].image_idxs.push_back(image_idx);
      scene.images.push_back({ImageId(static_cast<uint32_t>(image_idx)),
                              folder + "/" + frame_name,
                              0,
                              sensor,
                              frame_idxs[i],
                              {}});
    }
  }
  scene.sensors[0].sensor_from_rig = Rigid3();
  CheckConsistent(scene);
  return scene;
}

}  // namespace mgsfm

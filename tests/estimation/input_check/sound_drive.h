// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <string>
#include <utility>
#include <vector>

#include "mgsfm/input_check/finding.h"
#include "mgsfm/simulator/simulation.h"

namespace mgsfm {

// A drive with noise and a few wrong pairs, but without contradictions.
inline Simulation SoundDrive(RigPreset rig = RigPreset::kStereo,
                             PathPreset path = PathPreset::kCurve) {
  SimulationOptions options;
  options.rig = rig;
  options.path = path;
  options.num_frames = 40;
  options.max_num_features_per_image = 200;
  options.pixel_noise_px = 0.5;
  options.relative_rotation_noise_deg = 0.1;
  options.wrong_pair_ratio = 0.05;
  return Simulate(options);
}

inline std::vector<Cause> CausesOf(const std::vector<Finding>& findings) {
  std::vector<Cause> causes;
  for (const Finding& finding : findings) causes.push_back(finding.cause);
  return causes;
}

// Moves the images of a sensor to frames that are `lag` later. Images without
// such a frame lose their pairs.
inline void Delay(int sensor_idx, int lag, Simulation* simulation) {
  Scene& scene = simulation->scene;
  std::vector<std::pair<int, int>> moves;  // image, new frame
  for (size_t f = 0; f < scene.frames.size(); ++f) {
    auto& images = scene.frames[f].image_idxs;
    for (size_t k = 0; k < images.size(); ++k) {
      if (scene.images[images[k]].sensor_idx != sensor_idx) continue;
      moves.emplace_back(images[k], static_cast<int>(f) + lag);
      images.erase(images.begin() + static_cast<std::ptrdiff_t>(k));
      break;
    }
  }
  for (const auto& [image_idx, frame_idx] : moves) {
    if (frame_idx >= static_cast<int>(scene.frames.size())) {
      auto& pairs = simulation->view_graph.pairs;
      for (ImagePair& pair : pairs) {
        if (pair.image_idx1 == image_idx || pair.image_idx2 == image_idx) {
          pair.relative_pose.reset();
        }
      }
      continue;
    }
    scene.images[image_idx].frame_idx = frame_idx;
    scene.frames[frame_idx].image_idxs.push_back(image_idx);
  }
}

}  // namespace mgsfm

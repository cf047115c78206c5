// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <string>
#include <vector>

#include "mgsfm/scene/scene.h"
#include "mgsfm/synthetic/simulation.h"

namespace mgsfm {

// One camera of a simulated rig; the first of a rig is its reference.
struct SimulatedCamera {
  std::string folder;
  CameraModelId model;
  int width_px;
  int height_px;
  std::vector<double> params;
  Rigid3 sensor_from_rig;
};

std::vector<SimulatedCamera> MakeRig(RigPreset preset);

}  // namespace mgsfm

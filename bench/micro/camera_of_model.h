// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <string>
#include <vector>

#include "foundation/geometry/test_cameras.h"
#include "mgsfm/geometry/camera_models.h"

namespace mgsfm {

inline std::vector<TestCamera> CameraOfEachModel() {
  std::vector<TestCamera> cameras;
  for (const CameraModelInfo& model : AllCameraModels()) {
    for (const TestCamera& camera : AllTestCameras()) {
      if (camera.model != model.id) continue;
      cameras.push_back(camera);
      break;
    }
  }
  return cameras;
}

inline std::string ModelName(const TestCamera& camera) {
  return std::string(InfoOf(camera.model).name);
}

}  // namespace mgsfm

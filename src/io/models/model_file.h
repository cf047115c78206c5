// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <cstdint>
#include <filesystem>
#include <string>

#include "mgsfm/models/model_io.h"

namespace mgsfm {

// Values in COLMAP's model files: the sensor type of a camera, and the point id
// of a keypoint without a point.
constexpr int32_t kModelCameraType = 0;
constexpr uint64_t kModelNoPoint = ~uint64_t{0};

// folder/stem.bin or .txt.
inline std::filesystem::path ModelFilePath(const std::filesystem::path& folder,
                                           const std::string& stem,
                                           ModelFormat format) {
  return folder / (stem + (format == ModelFormat::kText ? ".txt" : ".bin"));
}

}  // namespace mgsfm

// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <cstdint>

namespace mgsfm {

// Values in the model files of COLMAP: the types of sensors, and the point of a
// keypoint that has none.
constexpr int32_t kModelCameraType = 0;
constexpr int32_t kModelImuType = 1;
constexpr uint64_t kModelNoPoint = ~uint64_t{0};

}  // namespace mgsfm

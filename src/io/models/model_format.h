// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <cstdint>

namespace mgsfm {

// Values in the model files of COLMAP: the type of a sensor that is a camera,
// and the point of a keypoint that has none.
constexpr int32_t kModelCameraType = 0;
constexpr uint64_t kModelNoPoint = ~uint64_t{0};

}  // namespace mgsfm

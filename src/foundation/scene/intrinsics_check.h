// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <optional>
#include <string>

#include "mgsfm/scene/scene.h"

namespace mgsfm {

// What is wrong with the intrinsics of a camera, as in "has its principal point
// (-9, 4) outside of the image of 640 x 480 px".
struct IntrinsicsProblem {
  std::string text;
  // No lens has these intrinsics.
  bool is_certain = false;
  // The values are probably for images of another size, or in another order.
  // Otherwise, they are unusable in part of the image.
  bool is_misread = false;
};

// Checks intrinsics from all sources: options, files, databases, models and
// calibrations. `camera` must have positive size and focal lengths (see
// WhyImplausible).
std::optional<IntrinsicsProblem> FindIntrinsicsProblem(const Camera& camera);

// Whether the focal length comes from EXIF. Feature extraction then knows the
// focal length, but neither distortion nor principal point.
[[nodiscard]] bool HasLensOfExif(const Camera& camera);

}  // namespace mgsfm

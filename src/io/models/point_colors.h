// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <filesystem>
#include <vector>

#include "mgsfm/base/context.h"
#include "mgsfm/scene/estimates.h"
#include "mgsfm/scene/scene.h"

namespace mgsfm {

// Colours every point with the mean, over its observations, of the bilinearly
// interpolated image at the keypoint. Points seen in none of the images found
// stay black. Each image file is read once, in parallel over images; at most
// num_threads images are in memory. Returns the names of the images that could
// not be read, sorted.
std::vector<std::string> ColorPoints(const Scene& scene,
                                     const std::filesystem::path& image_path,
                                     const Context& context,
                                     Reconstruction* reconstruction);

}  // namespace mgsfm

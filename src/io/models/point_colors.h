// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <filesystem>
#include <string>
#include <vector>

#include "mgsfm/base/context.h"
#include "mgsfm/scene/estimates.h"
#include "mgsfm/scene/scene.h"

namespace mgsfm {

// An image that provides no colors, and why: "cannot be read".
struct UncoloredImage {
  std::string name;
  std::string problem;
};

// Colors every point with the mean, over its observations, of the bilinearly
// interpolated image at the keypoint. Points without a usable image remain
// black. Each image file is read once, in parallel over images; at most
// num_threads images are in memory. Returns the images that could not be used,
// sorted by name: files that cannot be read, or of another size than the
// camera.
std::vector<UncoloredImage> ColorPoints(const Scene& scene,
                                        const std::filesystem::path& image_path,
                                        const Context& context,
                                        Reconstruction* reconstruction);

}  // namespace mgsfm

// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <cstdint>
#include <string>
#include <vector>

#include "mgsfm/base/context.h"
#include "mgsfm/scene/scene.h"

namespace mgsfm {

struct Thumbnail {
  int image_idx = 0;
  std::string jpeg;
};

// Small JPEGs of images of all frames or, if these need more than `max_bytes`,
// of frames at equal steps. Sorted by image. Images that cannot be read are
// skipped.
std::vector<Thumbnail> MakeThumbnails(const Scene& scene,
                                      const std::string& image_path,
                                      size_t max_bytes, const Context& context);

}  // namespace mgsfm

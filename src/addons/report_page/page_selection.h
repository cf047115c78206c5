// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <Eigen/Geometry>
#include <string>
#include <vector>

#include "mgsfm/base/context.h"
#include "mgsfm/scene/estimates.h"
#include "mgsfm/scene/scene.h"

namespace mgsfm {

// The part of space that the page shows: it holds all but the most extreme
// points and frames, so that single outliers do not determine the scale.
Eigen::AlignedBox3d ShownBox(const Reconstruction& reconstruction);

// Indices of the points in the box, at most `max_points`, by descending
// importance; each prefix represents the cloud (see report_page.h).
std::vector<size_t> SelectPoints(const Reconstruction& reconstruction,
                                 const Eigen::AlignedBox3d& box,
                                 size_t max_points);

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

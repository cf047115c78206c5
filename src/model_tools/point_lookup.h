// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <algorithm>
#include <cstddef>
#include <optional>
#include <utility>
#include <vector>

#include "mgsfm/scene/estimates.h"

namespace mgsfm {

// The point that each observation of a model belongs to. 8 bytes per
// observation.
class PointLookup {
 public:
  PointLookup(const Reconstruction& model, size_t num_images)
      : points_(num_images) {
    for (size_t i = 0; i < model.points.size(); ++i) {
      for (const Observation& o : model.points[i].track) {
        points_[o.image_idx].emplace_back(o.keypoint_idx, static_cast<int>(i));
      }
    }
    for (auto& of_image : points_) std::sort(of_image.begin(), of_image.end());
  }

  std::optional<int> Find(int image_idx, int keypoint_idx) const {
    const auto& of_image = points_[image_idx];
    const auto found = std::lower_bound(of_image.begin(), of_image.end(),
                                        std::make_pair(keypoint_idx, 0));
    if (found == of_image.end() || found->first != keypoint_idx) {
      return std::nullopt;
    }
    return found->second;
  }

 private:
  // Per image: keypoint and point, ascending.
  std::vector<std::vector<std::pair<int, int>>> points_;
};

}  // namespace mgsfm

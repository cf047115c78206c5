// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <cstddef>
#include <optional>
#include <vector>

#include "mgsfm/scene/estimates.h"
#include "mgsfm/scene/scene.h"

namespace mgsfm {

// The point that each keypoint of a model observes. 4 bytes per keypoint.
class PointLookup {
 public:
  PointLookup(const Scene& scene, const Reconstruction& model) {
    for (const Image& image : scene.images) {
      begin_.push_back(begin_.back() + image.keypoints_px.size());
    }
    point_.assign(begin_.back(), kNone);
    for (size_t i = 0; i < model.points.size(); ++i) {
      for (const Observation& o : model.points[i].track) {
        point_[begin_[o.image_idx] + o.keypoint_idx] = static_cast<int>(i);
      }
    }
  }

  // Also returns nullopt beyond the keypoints of the image.
  std::optional<int> Find(int image_idx, size_t keypoint_idx) const {
    const size_t position = begin_[image_idx] + keypoint_idx;
    if (position >= begin_[image_idx + 1] || point_[position] == kNone) {
      return std::nullopt;
    }
    return point_[position];
  }

 private:
  // Saves half of the memory of std::optional for many millions of keypoints.
  static constexpr int kNone = -1;
  std::vector<size_t> begin_ = {0};  // per image, and the end
  std::vector<int> point_;
};

}  // namespace mgsfm

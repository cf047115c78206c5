// SPDX-License-Identifier: BSD-3-Clause
#include "model_tools/sub_map_boundary.h"

#include <algorithm>
#include <utility>

#include "mgsfm/base/mask.h"

namespace mgsfm {

SubMapBoundary::SubMapBoundary(
    const std::vector<std::vector<std::string>>& names,
    const std::vector<CrossPair>& pairs) {
  std::set<std::string> met;
  for (const std::vector<std::string>& of_sub_map : names) {
    for (const std::string& name : of_sub_map) {
      if (!met.insert(name).second) common_images_.insert(name);
    }
  }
  for (const CrossPair& pair : pairs) {
    std::vector<uint32_t>& of1 = matched_keypoints_[pair.name1];
    std::vector<uint32_t>& of2 = matched_keypoints_[pair.name2];
    for (const Match& match : pair.matches) {
      of1.push_back(match.keypoint_idx1);
      of2.push_back(match.keypoint_idx2);
    }
  }
  for (auto& [name, keypoints] : matched_keypoints_) {
    std::sort(keypoints.begin(), keypoints.end());
    keypoints.erase(std::unique(keypoints.begin(), keypoints.end()),
                    keypoints.end());
    keypoints.shrink_to_fit();
  }
}

std::vector<Point3D> SubMapBoundary::TakeInterior(SceneModel* model) const {
  const std::vector<Image>& images = model->scene.images;
  Mask is_common;
  std::vector<const std::vector<uint32_t>*> matched;
  for (const Image& image : images) {
    is_common.push_back(common_images_.count(image.name) > 0);
    const auto found = matched_keypoints_.find(image.name);
    matched.push_back(found == matched_keypoints_.end() ? nullptr
                                                        : &found->second);
  }
  const auto is_interior = [&](const Observation& o) {
    const std::vector<uint32_t>* keypoints = matched[o.image_idx];
    return !is_common[o.image_idx] &&
           (keypoints == nullptr ||
            !std::binary_search(keypoints->begin(), keypoints->end(),
                                static_cast<uint32_t>(o.keypoint_idx)));
  };
  std::vector<Point3D>& points = model->reconstruction.points;
  std::vector<Point3D> interior, boundary;
  for (Point3D& point : points) {
    const bool all =
        std::all_of(point.track.begin(), point.track.end(), is_interior);
    (all ? interior : boundary).push_back(std::move(point));
  }
  points = std::move(boundary);
  return interior;
}

}  // namespace mgsfm

// SPDX-License-Identifier: BSD-3-Clause
#include <algorithm>

#include "base/parallel.h"
#include "matching/pair_lists.h"
#include "mgsfm/matching/pair_selection.h"

namespace mgsfm {
namespace {

struct PlacedImage {
  int image_idx;
  Eigen::Vector3d position;
};

std::vector<PlacedImage> PlaceImages(
    const Scene& scene,
    const std::vector<std::optional<Eigen::Vector3d>>& position_of_image,
    bool ignore_z) {
  std::vector<std::optional<Eigen::Vector3d>> position_of_frame(
      scene.frames.size());
  for (size_t i = 0; i < scene.images.size(); ++i) {
    auto& position = position_of_frame[scene.images[i].frame_idx];
    if (!position) position = position_of_image[i];
  }
  std::vector<PlacedImage> placed;
  for (size_t i = 0; i < scene.images.size(); ++i) {
    auto position = position_of_image[i];
    if (!position) position = position_of_frame[scene.images[i].frame_idx];
    if (!position) continue;
    if (ignore_z) position->z() = 0.0;
    placed.push_back({static_cast<int>(i), *position});
  }
  return placed;
}

ImagePairList NearestOf(const std::vector<PlacedImage>& images, size_t query,
                        const SpatialMatchingOptions& options) {
  struct Neighbor {
    double squared_distance;
    int image_idx;
    bool operator<(const Neighbor& other) const {
      return squared_distance != other.squared_distance
                 ? squared_distance < other.squared_distance
                 : image_idx < other.image_idx;
    }
  };
  std::vector<Neighbor> neighbors;
  const double max_squared_distance =
      options.max_distance * options.max_distance;
  for (size_t i = 0; i < images.size(); ++i) {
    if (i == query) continue;
    const double squared_distance =
        (images[i].position - images[query].position).squaredNorm();
    if (squared_distance <= max_squared_distance) {
      neighbors.push_back({squared_distance, images[i].image_idx});
    }
  }
  const size_t num_kept = std::min(
      neighbors.size(), static_cast<size_t>(options.max_num_neighbors));
  std::partial_sort(neighbors.begin(),
                    neighbors.begin() + static_cast<std::ptrdiff_t>(num_kept),
                    neighbors.end());
  ImagePairList pairs;
  for (size_t i = 0; i < num_kept; ++i) {
    pairs.push_back(
        internal::MakePair(images[query].image_idx, neighbors[i].image_idx));
  }
  return pairs;
}

}  // namespace

ImagePairList SpatialPairs(
    const Scene& scene,
    const std::vector<std::optional<Eigen::Vector3d>>& position_of_image,
    const SpatialMatchingOptions& options, const Context& context) {
  const std::vector<PlacedImage> images =
      PlaceImages(scene, position_of_image, options.ignore_z);
  std::vector<ImagePairList> pairs_of_image(images.size());
  ParallelFor(images.size(), context.num_threads, [&](size_t i) {
    pairs_of_image[i] = NearestOf(images, i, options);
  });
  ImagePairList pairs;
  for (const ImagePairList& list : pairs_of_image) {
    pairs.insert(pairs.end(), list.begin(), list.end());
  }
  internal::SortUnique(&pairs);
  return pairs;
}

}  // namespace mgsfm

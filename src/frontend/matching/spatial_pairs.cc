// SPDX-License-Identifier: BSD-3-Clause
#include <algorithm>
#include <flann/flann.hpp>
#include <limits>
#include <memory>
#include <vector>

#include "base/parallel.h"
#include "matching/pair_lists.h"
#include "matching/pair_selection.h"

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

// Exact nearest neighbors in a kd-tree. FLANN alone breaks ties by the layout
// of its tree, and images of one frame often share a position. It therefore
// only bounds the distance of the last neighbor; all images within it are
// sorted.
class NearestImages {
 public:
  NearestImages(const std::vector<PlacedImage>& images,
                const SpatialMatchingOptions& options)
      : images_(images),
        max_num_(std::min(static_cast<size_t>(options.max_num_neighbors),
                          images.size() - 1)),
        max_squared_distance_(options.max_distance * options.max_distance) {
    for (const PlacedImage& image : images) {
      coordinates_.insert(coordinates_.end(), image.position.begin(),
                          image.position.end());
    }
    index_ = std::make_unique<Index>(
        Coordinates(coordinates_.data(), images.size(), 3),
        flann::KDTreeSingleIndexParams());
    index_->buildIndex();
  }

  // Indices of images, the nearest first, of equally near ones the first.
  std::vector<int> Find(size_t query) const {
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
    for (const size_t i : FindCandidates(query)) {
      const double squared_distance =
          (images_[i].position - images_[query].position).squaredNorm();
      if (i == query || squared_distance > max_squared_distance_) continue;
      neighbors.push_back({squared_distance, images_[i].image_idx});
    }
    std::sort(neighbors.begin(), neighbors.end());
    if (neighbors.size() > max_num_) neighbors.resize(max_num_);
    std::vector<int> image_idxs;
    for (const Neighbor& neighbor : neighbors) {
      image_idxs.push_back(neighbor.image_idx);
    }
    return image_idxs;
  }

 private:
  using Index = flann::KDTreeSingleIndex<flann::L2_Simple<double>>;
  using Coordinates = flann::Matrix<double>;

  // All images as near as the last neighbor, including the query itself.
  std::vector<size_t> FindCandidates(size_t query) const {
    const flann::SearchParams exact(flann::FLANN_CHECKS_UNLIMITED);
    Eigen::Vector3d position = images_[query].position;
    const Coordinates queries(position.data(), 1, 3);
    std::vector<std::vector<size_t>> idxs;
    std::vector<std::vector<double>> squared_distances;
    index_->knnSearch(queries, idxs, squared_distances, max_num_ + 1, exact);
    const double squared_radius =
        std::min(squared_distances[0].back(), max_squared_distance_);
    // FLANN excludes the radius itself and takes it as a float.
    constexpr double kMargin = 8.0 * std::numeric_limits<float>::epsilon();
    index_->radiusSearch(queries, idxs, squared_distances,
                         static_cast<float>(squared_radius * (1.0 + kMargin)) +
                             std::numeric_limits<float>::min(),
                         exact);
    return idxs[0];
  }

  const std::vector<PlacedImage>& images_;
  const size_t max_num_;
  const double max_squared_distance_;
  std::vector<double> coordinates_;  // 3 per image
  std::unique_ptr<Index> index_;
};

}  // namespace

ImagePairList SpatialPairs(
    const Scene& scene,
    const std::vector<std::optional<Eigen::Vector3d>>& position_of_image,
    const SpatialMatchingOptions& options, const Context& context) {
  const std::vector<PlacedImage> images =
      PlaceImages(scene, position_of_image, options.ignore_z);
  if (images.size() < 2) return {};
  const NearestImages nearest(images, options);
  std::vector<ImagePairList> pairs_of_image(images.size());
  ParallelFor(images.size(), context.num_threads, [&](size_t i) {
    for (const int image_idx : nearest.Find(i)) {
      pairs_of_image[i].push_back(
          internal::MakePair(images[i].image_idx, image_idx));
    }
  });
  ImagePairList pairs;
  for (const ImagePairList& list : pairs_of_image) {
    pairs.insert(pairs.end(), list.begin(), list.end());
  }
  internal::SortUnique(&pairs);
  return pairs;
}

}  // namespace mgsfm

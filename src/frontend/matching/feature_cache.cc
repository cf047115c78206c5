// SPDX-License-Identifier: BSD-3-Clause
#include "matching/feature_cache.h"

#include <algorithm>
#include <string>
#include <utility>

#include "base/parallel.h"
#include "mgsfm/base/error.h"
#include "mgsfm/geometry/camera_models.h"

namespace mgsfm::internal {

DescriptorMatrix ReadSiftDescriptors(const FeatureDatabase& database,
                                     const Image& image, size_t num_keypoints) {
  DescriptorMatrix descriptors = database.ReadDescriptors(image.id);
  const auto num_rows = static_cast<size_t>(descriptors.rows());
  if (num_rows != num_keypoints) {
    throw Error("database '" + database.path() + "': image '" + image.name +
                "' has " + std::to_string(num_keypoints) + " keypoints but " +
                std::to_string(num_rows) +
                " descriptors; extract its features again");
  }
  if (num_rows > 0 &&
      static_cast<size_t>(descriptors.cols()) != DescriptorView::kDim) {
    throw Error("database '" + database.path() + "': image '" + image.name +
                "' has descriptors of " + std::to_string(descriptors.cols()) +
                " bytes; only SIFT descriptors (128 bytes) can be matched");
  }
  return descriptors;
}

size_t ImageFeatures::NumBytes() const {
  return keypoints_px.size() *
         (sizeof(Eigen::Vector2f) + sizeof(std::optional<Eigen::Vector3d>) +
          DescriptorView::kDim);
}

bool FeatureCache::HasRoomFor(int image_idx) const {
  const auto found = features_.find(image_idx);
  return (found != features_.end() && found->second.last_batch == batch_) ||
         num_batch_bytes_ < max_num_bytes_;
}

void FeatureCache::AddToBatch(int image_idx, bool needs_descriptors) {
  if (features_.count(image_idx) == 0) Read(image_idx);
  ImageFeatures& features = features_.at(image_idx);
  if (needs_descriptors && !features.has_descriptors) {
    features.descriptors = ReadSiftDescriptors(
        database_, scene_.images[image_idx], features.keypoints_px.size());
    features.has_descriptors = true;
  }
  if (features.last_batch == batch_) return;
  features.last_batch = batch_;
  num_batch_bytes_ += features.NumBytes();
  MakeRoom();
}

void FeatureCache::Read(int image_idx) {
  const Image& image = scene_.images[image_idx];
  ImageFeatures features;
  for (const FeatureKeypoint& keypoint : database_.ReadKeypoints(image.id)) {
    features.keypoints_px.emplace_back(keypoint.x_px, keypoint.y_px);
  }
  num_bytes_ += features.NumBytes();
  features_.emplace(image_idx, std::move(features));
}

void FeatureCache::MakeRoom() {
  while (num_bytes_ > max_num_bytes_) {
    const auto oldest = std::min_element(
        features_.begin(), features_.end(), [](const auto& a, const auto& b) {
          return a.second.last_batch < b.second.last_batch;
        });
    if (oldest->second.last_batch == batch_) return;
    num_bytes_ -= oldest->second.NumBytes();
    features_.erase(oldest);
  }
}

void FeatureCache::ComputeRays(const Context& context) {
  std::vector<std::pair<int, ImageFeatures*>> images;
  for (auto& [image_idx, features] : features_) {
    if (features.rays.size() != features.keypoints_px.size()) {
      images.emplace_back(image_idx, &features);
    }
  }
  ParallelFor(
      images.size(), context.num_threads,
      [&](size_t i) {
        const auto& [image_idx, features] = images[i];
        const Camera& camera =
            scene_.cameras[scene_.images[image_idx].camera_idx];
        features->rays.reserve(features->keypoints_px.size());
        for (const Eigen::Vector2f& keypoint : features->keypoints_px) {
          features->rays.push_back(RayFromPixel(
              camera.model, camera.params.data(), keypoint.cast<double>()));
        }
      },
      1);
}

}  // namespace mgsfm::internal

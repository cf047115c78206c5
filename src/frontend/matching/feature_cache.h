// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <cstddef>
#include <map>
#include <optional>
#include <vector>

#include "matching/descriptor_matching.h"
#include "matching/two_view_verification.h"
#include "mgsfm/base/context.h"
#include "mgsfm/database/feature_database.h"
#include "mgsfm/scene/scene.h"

namespace mgsfm::internal {

// Reads the descriptors of an image. Throws Error, naming the image, unless
// there is one SIFT descriptor per keypoint.
DescriptorMatrix ReadSiftDescriptors(const FeatureDatabase& database,
                                     const Image& image, size_t num_keypoints);

struct ImageFeatures {
  std::vector<Eigen::Vector2f> keypoints_px;
  std::vector<std::optional<Eigen::Vector3d>> rays;  // see VerificationView
  DescriptorMatrix descriptors;  // if some batch needed them
  bool has_descriptors = false;
  size_t last_batch = 0;  // the last one that used it

  DescriptorView Descriptors() const {
    return {descriptors.data(), static_cast<size_t>(descriptors.rows())};
  }
  VerificationView View(const Camera& camera) const {
    return {&camera, &keypoints_px, &rays};
  }
  size_t NumBytes() const;
};

// Least-recently-used cache of image features. Its size is bounded, but a batch
// may exceed the bound by one image. Not thread-safe except for Get.
class FeatureCache {
 public:
  FeatureCache(const FeatureDatabase& database, const Scene& scene,
               size_t max_num_bytes)
      : database_(database), scene_(scene), max_num_bytes_(max_num_bytes) {}

  void StartBatch() {
    ++batch_;
    num_batch_bytes_ = 0;
  }
  // Whether the image is in the batch or may be added to it.
  bool HasRoomFor(int image_idx) const;
  // Verification of existing matches needs no descriptors.
  void AddToBatch(int image_idx, bool needs_descriptors);
  // Call it after all images of the batch were added.
  void ComputeRays(const Context& context);

  const ImageFeatures& Get(int image_idx) const {
    return features_.at(image_idx);
  }

 private:
  void Read(int image_idx);
  void MakeRoom();

  const FeatureDatabase& database_;
  const Scene& scene_;
  const size_t max_num_bytes_;
  size_t batch_ = 0;
  size_t num_bytes_ = 0;
  size_t num_batch_bytes_ = 0;
  std::map<int, ImageFeatures> features_;
};

}  // namespace mgsfm::internal

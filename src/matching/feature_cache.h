// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <cstddef>
#include <map>
#include <vector>

#include "mgsfm/base/context.h"
#include "mgsfm/io/database/feature_database.h"
#include "mgsfm/matching/descriptor_matching.h"
#include "mgsfm/matching/two_view_verification.h"
#include "mgsfm/scene/scene.h"

namespace mgsfm::internal {

// The descriptors of an image. Throws Error, naming it, unless there is a SIFT
// descriptor for each keypoint.
DescriptorMatrix ReadSiftDescriptors(const FeatureDatabase& database,
                                     const Image& image, size_t num_keypoints);

struct ImageFeatures {
  std::vector<Eigen::Vector2f> keypoints_px;
  KeypointRays rays;
  DescriptorMatrix descriptors;
  size_t last_batch = 0;  // that used it

  DescriptorView Descriptors() const {
    return {descriptors.data(), static_cast<size_t>(descriptors.rows())};
  }
  VerificationView View(const Camera& camera) const {
    return {&camera, &keypoints_px, &rays};
  }
  size_t NumBytes() const;
};

// Features of images in memory, up to a bound that one batch may exceed by an
// image. Those not used for longest make room. Reading is for one thread.
class FeatureCache {
 public:
  FeatureCache(const FeatureDatabase& database, const Scene& scene,
               size_t max_num_bytes)
      : database_(database), scene_(scene), max_num_bytes_(max_num_bytes) {}

  void StartBatch() {
    ++batch_;
    num_batch_bytes_ = 0;
  }
  // Whether the image is of the batch, or may be added to it.
  bool HasRoomFor(int image_idx) const;
  void AddToBatch(int image_idx);
  // After all were added.
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

// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <cstddef>
#include <cstdint>
#include <map>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "matching/descriptor_matching.h"
#include "matching/pair_selection.h"
#include "matching/two_view_verification.h"
#include "mgsfm/base/context.h"
#include "mgsfm/database/feature_database.h"
#include "mgsfm/scene/scene.h"
#include "mgsfm/scene/view_graph.h"
#include "scene/item_lists.h"

namespace mgsfm {

// Conversion between rows of a database and indices into its scene. The two
// images of a pair are in the order of the scene, which is by name, so that
// results do not depend on ids.

class ImageIdxs {
 public:
  explicit ImageIdxs(const Scene& scene) : idxs_(IndexById(scene.images)) {}
  std::optional<ImageIdxPair> Find(const PairCount& row) const;

 private:
  std::map<ImageId, int> idxs_;
};

std::pair<ImageId, ImageId> IdsOf(const Scene& scene, const ImageIdxPair& pair);

// The database with the features, which may be read-only, and the database for
// matches. They are the same, or the second is a shard.
struct MatchDatabases {
  const FeatureDatabase& features;
  FeatureDatabase& output;

  bool AreOne() const { return &features == &output; }
};

// Pairs with a row in either database, by index.
std::vector<std::pair<ImageIdxPair, size_t>> CountRows(
    const MatchDatabases& databases, const Scene& scene,
    std::vector<PairCount> (FeatureDatabase::*rows)() const);

// The matches of a pair, with the order of images of the scene, sorted by
// keypoint indices; from the output database if it has a row of the pair.
std::vector<Match> ReadMatchesOfPair(const FeatureDatabase& database,
                                     const Scene& scene,
                                     const ImageIdxPair& pair);
std::vector<Match> ReadMatchesOfPair(const MatchDatabases& databases,
                                     const Scene& scene,
                                     const ImageIdxPair& pair);

// Throws Error, naming the images, if a match refers to a missing keypoint.
void CheckMatches(const Scene& scene, const ImageIdxPair& pair,
                  const std::vector<Match>& matches, size_t num_keypoints1,
                  size_t num_keypoints2);

// Seed of a pair that depends on names only, not on ids or processing order.
uint64_t PairSeed(const std::string& image_name1,
                  const std::string& image_name2, uint64_t random_seed);

// Reads the descriptors of an image. Throws Error, naming the image, unless
// there is one SIFT descriptor per keypoint.
DescriptorMatrix ReadSiftDescriptors(const FeatureDatabase& database,
                                     const Image& image, size_t num_keypoints);

struct ImageFeatures {
  std::vector<Eigen::Vector2f> keypoints_px;
  std::vector<std::optional<Eigen::Vector3d>> rays;  // see VerificationView
  std::vector<uint32_t> landmarks;                   // see guided_matching.h
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
  // Must be called after all images of the batch were added.
  void ComputeRays(const Context& context);

  const ImageFeatures& Get(int image_idx) const {
    return features_.at(image_idx);
  }
  // CheckMatches() of two images of the batch.
  void Check(const ImageIdxPair& pair, const std::vector<Match>& matches) const;

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

}  // namespace mgsfm

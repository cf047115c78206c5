// SPDX-License-Identifier: BSD-3-Clause
#include "matching/scene_pairs.h"

#include <algorithm>
#include <string>
#include <utility>

#include "base/fingerprint.h"
#include "base/parallel.h"
#include "base/random.h"
#include "base/ranges.h"
#include "matching/guided_matching.h"
#include "matching/pair_selection.h"
#include "mgsfm/base/error.h"
#include "mgsfm/geometry/camera_models.h"

namespace mgsfm {

std::optional<ImageIdxPair> ImageIdxs::Find(const PairCount& row) const {
  const auto image1 = idxs_.find(row.image_id1);
  const auto image2 = idxs_.find(row.image_id2);
  if (image1 == idxs_.end() || image2 == idxs_.end()) return std::nullopt;
  return MakePair(image1->second, image2->second);
}

std::vector<std::pair<ImageIdxPair, size_t>> CountRows(
    const MatchDatabases& databases, const Scene& scene,
    std::vector<PairCount> (FeatureDatabase::*rows)() const) {
  const ImageIdxs image_idxs(scene);
  std::vector<std::pair<ImageIdxPair, size_t>> pairs;
  for (const FeatureDatabase* database :
       {&std::as_const(databases.output), &databases.features}) {
    for (const PairCount& row : (database->*rows)()) {
      if (const auto pair = image_idxs.Find(row)) {
        pairs.emplace_back(*pair, row.num_matches);
      }
    }
    if (databases.AreOne()) break;
  }
  return pairs;
}

std::pair<ImageId, ImageId> IdsOf(const Scene& scene,
                                  const ImageIdxPair& pair) {
  return {scene.images[pair.image_idx1].id, scene.images[pair.image_idx2].id};
}

std::vector<Match> ReadMatchesOfPair(const FeatureDatabase& database,
                                     const Scene& scene,
                                     const ImageIdxPair& pair) {
  const auto [id1, id2] = IdsOf(scene, pair);
  std::vector<Match> matches = database.ReadMatches(id1, id2);
  SortBy(&matches, [](const Match& match) {
    return std::pair(match.keypoint_idx1, match.keypoint_idx2);
  });
  return matches;
}

std::vector<Match> ReadMatchesOfPair(const MatchDatabases& databases,
                                     const Scene& scene,
                                     const ImageIdxPair& pair) {
  const auto [id1, id2] = IdsOf(scene, pair);
  const bool is_output =
      databases.AreOne() || databases.output.HasMatches(id1, id2);
  return ReadMatchesOfPair(is_output ? databases.output : databases.features,
                           scene, pair);
}

void CheckMatches(const Scene& scene, const ImageIdxPair& pair,
                  const std::vector<Match>& matches, size_t num_keypoints1,
                  size_t num_keypoints2) {
  for (const Match& match : matches) {
    if (match.keypoint_idx1 < num_keypoints1 &&
        match.keypoint_idx2 < num_keypoints2) {
      continue;
    }
    throw Error("a match of images '" + scene.images[pair.image_idx1].name +
                "' and '" + scene.images[pair.image_idx2].name +
                "' refers to keypoints " + std::to_string(match.keypoint_idx1) +
                " and " + std::to_string(match.keypoint_idx2) +
                ", but the images have " + std::to_string(num_keypoints1) +
                " and " + std::to_string(num_keypoints2) +
                "; remove these matches, they belong to other features");
  }
}

uint64_t PairSeed(const std::string& image_name1,
                  const std::string& image_name2, uint64_t random_seed) {
  Fingerprint names;
  for (const char c : image_name1) names.Add(c);
  names.Add('\0');
  for (const char c : image_name2) names.Add(c);
  return Random(random_seed, names.hash()).NextBits();
}

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

void FeatureCache::Check(const ImageIdxPair& pair,
                         const std::vector<Match>& matches) const {
  CheckMatches(scene_, pair, matches, Get(pair.image_idx1).keypoints_px.size(),
               Get(pair.image_idx2).keypoints_px.size());
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
  const auto keypoints = database_.ReadKeypoints(image.id);
  ImageFeatures features;
  features.landmarks =
      SelectLandmarks(scene_.cameras[image.camera_idx], keypoints);
  for (const FeatureKeypoint& keypoint : keypoints) {
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
          features->rays.push_back(
              RayFromPixel(camera, keypoint.cast<double>()));
        }
      },
      1);
}

}  // namespace mgsfm

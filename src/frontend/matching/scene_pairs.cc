// SPDX-License-Identifier: BSD-3-Clause
#include "matching/scene_pairs.h"

#include <algorithm>
#include <tuple>

#include "base/random.h"
#include "matching/pair_lists.h"
#include "mgsfm/base/error.h"

namespace mgsfm::internal {

ImageIdxs::ImageIdxs(const Scene& scene) {
  for (size_t i = 0; i < scene.images.size(); ++i) {
    idxs_.emplace(scene.images[i].id, static_cast<int>(i));
  }
}

std::optional<int> ImageIdxs::Find(ImageId id) const {
  const auto found = idxs_.find(id);
  if (found == idxs_.end()) return std::nullopt;
  return found->second;
}

std::optional<ImageIdxPair> ImageIdxs::Find(const PairCount& row) const {
  const auto image1 = Find(row.image_id1);
  const auto image2 = Find(row.image_id2);
  if (!image1 || !image2) return std::nullopt;
  return MakePair(*image1, *image2);
}

namespace {

using PairCounts = std::vector<std::pair<ImageIdxPair, size_t>>;

void AddPairs(const std::vector<PairCount>& rows, const ImageIdxs& image_idxs,
              PairCounts* pairs) {
  for (const PairCount& row : rows) {
    if (const auto pair = image_idxs.Find(row)) {
      pairs->emplace_back(*pair, row.num_matches);
    }
  }
}

}  // namespace

PairCounts CountMatches(const MatchDatabases& databases, const Scene& scene) {
  const ImageIdxs image_idxs(scene);
  PairCounts pairs;
  AddPairs(databases.output.CountMatches(), image_idxs, &pairs);
  if (!databases.AreOne()) {
    AddPairs(databases.features.CountMatches(), image_idxs, &pairs);
  }
  return pairs;
}

PairCounts CountInlierMatches(const MatchDatabases& databases,
                              const Scene& scene) {
  const ImageIdxs image_idxs(scene);
  PairCounts pairs;
  AddPairs(databases.output.CountInlierMatches(), image_idxs, &pairs);
  if (!databases.AreOne()) {
    AddPairs(databases.features.CountInlierMatches(), image_idxs, &pairs);
  }
  return pairs;
}

std::vector<Match> ReadMatchesOfPair(const FeatureDatabase& database,
                                     const Scene& scene,
                                     const ImageIdxPair& pair) {
  std::vector<Match> matches = database.ReadMatches(
      scene.images[pair.image_idx1].id, scene.images[pair.image_idx2].id);
  std::sort(matches.begin(), matches.end(), [](const Match& a, const Match& b) {
    return std::tie(a.keypoint_idx1, a.keypoint_idx2) <
           std::tie(b.keypoint_idx1, b.keypoint_idx2);
  });
  return matches;
}

std::vector<Match> ReadMatchesOfPair(const MatchDatabases& databases,
                                     const Scene& scene,
                                     const ImageIdxPair& pair) {
  const bool is_output =
      databases.AreOne() ||
      databases.output.HasMatches(scene.images[pair.image_idx1].id,
                                  scene.images[pair.image_idx2].id);
  return ReadMatchesOfPair(is_output ? databases.output : databases.features,
                           scene, pair);
}

void CheckMatches(const std::vector<Match>& matches, size_t num_keypoints1,
                  size_t num_keypoints2, const std::string& image_name1,
                  const std::string& image_name2) {
  for (const Match& match : matches) {
    if (match.keypoint_idx1 < num_keypoints1 &&
        match.keypoint_idx2 < num_keypoints2) {
      continue;
    }
    throw Error("a match of images '" + image_name1 + "' and '" + image_name2 +
                "' refers to keypoints " + std::to_string(match.keypoint_idx1) +
                " and " + std::to_string(match.keypoint_idx2) +
                ", but the images have " + std::to_string(num_keypoints1) +
                " and " + std::to_string(num_keypoints2) +
                "; remove these matches, they belong to other features");
  }
}

uint64_t PairSeed(const std::string& image_name1,
                  const std::string& image_name2, uint64_t random_seed) {
  // FNV-1a with the constants of the 64-bit variant.
  uint64_t hash = 0xcbf29ce484222325ull;
  const auto add = [&](unsigned char byte) {
    hash = (hash ^ byte) * 0x100000001b3ull;
  };
  for (const char c : image_name1) add(static_cast<unsigned char>(c));
  add(0);
  for (const char c : image_name2) add(static_cast<unsigned char>(c));
  return Random(random_seed, hash).NextBits();
}

TwoViewGeometryRow MakeTwoViewRow(const Scene& scene, const ImageIdxPair& pair,
                                  const ImagePair& verified) {
  TwoViewGeometryRow row{scene.images[pair.image_idx1].id,
                         scene.images[pair.image_idx2].id,
                         verified.config,
                         verified.F,
                         verified.E,
                         verified.H,
                         std::nullopt,
                         verified.matches};
  // COLMAP's format has no missing translation; zero means no direction.
  if (verified.relative_pose) {
    row.cam2_from_cam1 =
        Rigid3{verified.relative_pose->cam2_from_cam1,
               verified.relative_pose->translation_direction.value_or(
                   Eigen::Vector3d::Zero())};
  }
  return row;
}

}  // namespace mgsfm::internal

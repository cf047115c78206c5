// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <cstdint>
#include <map>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "matching/pair_selection.h"
#include "mgsfm/database/feature_database.h"
#include "mgsfm/scene/scene.h"
#include "mgsfm/scene/view_graph.h"

namespace mgsfm::internal {

// Conversion between rows of a database and indices into its scene. The two
// images of a pair are in the order of the scene, which is by name, so that
// results do not depend on ids.

class ImageIdxs {
 public:
  explicit ImageIdxs(const Scene& scene);
  std::optional<int> Find(ImageId id) const;
  std::optional<ImageIdxPair> Find(const PairCount& row) const;

 private:
  std::map<ImageId, int> idxs_;
};

// The database with the features, which may be only read, and the one that
// matches are written to. They are the same, or the second is a shard.
struct MatchDatabases {
  const FeatureDatabase& features;
  FeatureDatabase& output;

  bool AreOne() const { return &features == &output; }
};

// Pairs with a row in either database, by index.
std::vector<std::pair<ImageIdxPair, size_t>> CountMatches(
    const MatchDatabases& databases, const Scene& scene);
std::vector<std::pair<ImageIdxPair, size_t>> CountInlierMatches(
    const MatchDatabases& databases, const Scene& scene);

// The matches of a pair, image 1 of the scene first, sorted by keypoint
// indices; from the output database if it has a row of the pair.
std::vector<Match> ReadMatchesOfPair(const FeatureDatabase& database,
                                     const Scene& scene,
                                     const ImageIdxPair& pair);
std::vector<Match> ReadMatchesOfPair(const MatchDatabases& databases,
                                     const Scene& scene,
                                     const ImageIdxPair& pair);

// Throws Error, naming the images, if a match refers to a missing keypoint.
void CheckMatches(const std::vector<Match>& matches, size_t num_keypoints1,
                  size_t num_keypoints2, const std::string& image_name1,
                  const std::string& image_name2);

// Seed of a pair that depends on names only, not on ids or order of work.
uint64_t PairSeed(const std::string& image_name1,
                  const std::string& image_name2, uint64_t random_seed);

TwoViewGeometryRow MakeTwoViewRow(const Scene& scene, const ImageIdxPair& pair,
                                  const ImagePair& verified);

}  // namespace mgsfm::internal

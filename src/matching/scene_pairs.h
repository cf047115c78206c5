// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <map>
#include <optional>
#include <string>
#include <vector>

#include "mgsfm/io/database/feature_database.h"
#include "mgsfm/matching/pair_selection.h"
#include "mgsfm/scene/scene.h"
#include "mgsfm/scene/view_graph.h"

namespace mgsfm::internal {

// From rows of a database to positions in the scene made of it, and back.
// Whatever depends on the order of the two images of a pair uses that of the
// scene, by name, so that ids do not matter.

class ImageIdxs {
 public:
  explicit ImageIdxs(const Scene& scene);
  std::optional<int> Find(ImageId id) const;
  std::optional<ImageIdxPair> Find(const PairCount& row) const;

 private:
  std::map<ImageId, int> idxs_;
};

// In the order of the scene, sorted.
std::vector<Match> ReadMatchesOfPair(const FeatureDatabase& database,
                                     const Scene& scene,
                                     const ImageIdxPair& pair);

// Throws Error, naming the images, if a match is of no keypoint.
void CheckMatches(const std::vector<Match>& matches, size_t num_keypoints1,
                  size_t num_keypoints2, const std::string& image_name1,
                  const std::string& image_name2);

TwoViewGeometryRow MakeTwoViewRow(const Scene& scene, const ImageIdxPair& pair,
                                  const ImagePair& verified);

}  // namespace mgsfm::internal

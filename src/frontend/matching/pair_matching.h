// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <cstddef>
#include <map>
#include <optional>
#include <set>
#include <string_view>
#include <vector>

#include "matching/pair_selection.h"
#include "matching/scene_pairs.h"
#include "mgsfm/base/context.h"
#include "mgsfm/database/feature_database.h"
#include "mgsfm/matching/matching.h"
#include "mgsfm/scene/scene.h"

namespace mgsfm {

// Progress of a list of pairs that is one of several: the number of pairs in
// previous lists, and in all lists.
struct ProgressSpan {
  size_t num_before = 0;
  size_t total = 0;
};

// Matches and verifies image pairs of a database and writes the results, one
// transaction per batch; see matching.h. `scene` is the scene of the database
// with the features.
class PairMatcher {
 public:
  // Reads which pairs the databases contain.
  PairMatcher(const MatchDatabases& databases, const Scene& scene,
              const PairMatchingOptions& options, const Context& context);

  // Matches each pair without matches and verifies each pair without two-view
  // geometry. Reports progress within `span`, by default for `pairs` alone.
  PairMatchingSummary Run(const ImagePairList& pairs, std::string_view stage,
                          std::optional<ProgressSpan> span = std::nullopt);

  // 0 if the pair has fewer than min_num_inliers inliers.
  size_t NumInliers(const ImageIdxPair& pair) const;

 private:
  struct Result;

  std::vector<ImageIdxPair> NextBatch(const ImagePairList& pairs, size_t* next);
  Result MatchPair(const ImageIdxPair& pair, std::vector<Match> matches,
                   bool has_matches) const;
  void Write(const std::vector<ImageIdxPair>& batch,
             const std::vector<Result>& results);

  const MatchDatabases databases_;
  const Scene& scene_;
  const PairMatchingOptions& options_;
  const Context& context_;
  FeatureCache cache_;
  std::set<ImageIdxPair> matched_;
  std::map<ImageIdxPair, size_t> num_inliers_;  // of pairs with a geometry
};

// One share of the pairs. All pairs of two frames are in one share, because rig
// verification needs them together; shares have about the same number of pairs.
// Pairs of two blocks of some 50 images are consecutive, so that the features
// of an image are read once for many pairs.
ImagePairList PairsOfShare(const ImagePairList& pairs, const Scene& scene,
                           const Share& share);

// Matches and verifies one share of `pairs`, which must be the same in all
// processes, and writes the matches into a separate database, a shard.
// `features` is open kReadOnly; pairs that it already has are not matched
// again. A share may be empty. Throws Error if `shard` is a different shard or
// not a shard.
PairMatchingSummary MatchShare(const FeatureDatabase& features,
                               const Scene& scene, const ImagePairList& pairs,
                               const Share& share,
                               const PairMatchingOptions& options,
                               FeatureDatabase* shard, const Context& context);

}  // namespace mgsfm

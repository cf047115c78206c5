// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <cstddef>
#include <map>
#include <memory>
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

namespace internal {
class FeatureCache;
}  // namespace internal

// Progress of a list of pairs that is one of several: the number of pairs in
// the lists before it, and in all lists.
struct ProgressSpan {
  size_t num_before = 0;
  size_t total = 0;
};

// Matches and verifies image pairs of a database and writes the results, one
// transaction per batch; see matching.h. `scene` is the scene of the database
// with the features.
class PairMatcher {
 public:
  // Finds out which pairs the databases contain.
  PairMatcher(const internal::MatchDatabases& databases, const Scene& scene,
              const PairMatchingOptions& options, const Context& context);
  ~PairMatcher();

  // Matches each pair without matches and verifies each pair without two-view
  // geometry. Reports progress within `span`, by default that of `pairs` alone.
  PairMatchingSummary Run(const ImagePairList& pairs, std::string_view stage,
                          std::optional<ProgressSpan> span = std::nullopt);

  // Whether the pair has at least min_num_inliers inliers.
  bool IsVerified(const ImageIdxPair& pair) const;

 private:
  struct Result;

  std::vector<ImageIdxPair> NextBatch(const ImagePairList& pairs, size_t* next);
  Result MatchPair(const ImageIdxPair& pair, std::vector<Match> matches,
                   bool has_matches) const;
  void Write(const std::vector<ImageIdxPair>& batch,
             const std::vector<Result>& results);

  const internal::MatchDatabases databases_;
  const Scene& scene_;
  const PairMatchingOptions& options_;
  const Context& context_;
  std::unique_ptr<internal::FeatureCache> cache_;
  std::set<ImageIdxPair> matched_;
  std::map<ImageIdxPair, size_t> num_inliers_;  // of pairs with a geometry
};

}  // namespace mgsfm

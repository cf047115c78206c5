// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <cstddef>
#include <map>
#include <memory>
#include <set>
#include <string_view>
#include <vector>

#include "mgsfm/base/context.h"
#include "mgsfm/base/options.h"
#include "mgsfm/io/database/feature_database.h"
#include "mgsfm/matching/descriptor_matching.h"
#include "mgsfm/matching/pair_selection.h"
#include "mgsfm/matching/rig_verification.h"
#include "mgsfm/matching/two_view_verification.h"
#include "mgsfm/scene/scene.h"

namespace mgsfm {

namespace internal {
class FeatureCache;
}  // namespace internal

struct PairMatchingOptions {
  DescriptorMatchingOptions matching;
  TwoViewGeometryOptions two_view_geometry;
  RigVerificationOptions rig_verification;
  int cache_size_mib = 1024;

  template <class Self, class Visitor>
  static void Describe(Self& self, Visitor& visit) {
    visit("cache_size", self.cache_size_mib, AtLeast(1), "MiB",
          "Features kept in memory; matching two images needs at least "
          "those of both.");
    visit.Group("SiftMatching", self.matching);
    visit.Group("TwoViewGeometry", self.two_view_geometry);
    visit.Group("FeatureMatching", self.rig_verification);
  }
};

struct PairMatchingSummary {
  size_t num_pairs = 0;     // asked for
  size_t num_done = 0;      // of them, in the database already
  size_t num_verified = 0;  // of all, with enough inliers
};

// Where a list of pairs is in a longer one, for progress.
struct ProgressSpan {
  size_t num_before = 0;
  size_t total = 0;  // 0: the list is all
};

// Matches and verifies pairs of images of a database, and writes the results
// there, a batch at a time in a transaction: what an interrupted run wrote is
// not done again, so that it goes on where it stopped. Results depend on the
// images, their names, the options and the seed only. The images are those of
// a scene made of the database.
class PairMatcher {
 public:
  // Finds what is in the database already.
  PairMatcher(FeatureDatabase* database, const Scene& scene,
              const PairMatchingOptions& options, const Context& context);
  ~PairMatcher();

  // Matches, unless there are matches, and verifies, unless there is a two-view
  // geometry. Throws Error, naming the image or pair, for features that do not
  // fit together.
  PairMatchingSummary Run(const ImagePairList& pairs, std::string_view stage,
                          const ProgressSpan& span = {});

  // Whether the pair was found to have enough inliers.
  bool IsVerified(const ImageIdxPair& pair) const;

 private:
  struct Result;

  std::vector<ImageIdxPair> NextBatch(const ImagePairList& pairs, size_t* next);
  Result MatchPair(const ImageIdxPair& pair, std::vector<Match> matches,
                   bool has_matches) const;
  void Write(const std::vector<ImageIdxPair>& batch,
             const std::vector<Result>& results);

  FeatureDatabase* database_;
  const Scene& scene_;
  const PairMatchingOptions& options_;
  const Context& context_;
  std::unique_ptr<internal::FeatureCache> cache_;
  std::set<ImageIdxPair> matched_;
  std::map<ImageIdxPair, size_t> num_inliers_;  // of two-view geometries
};

}  // namespace mgsfm

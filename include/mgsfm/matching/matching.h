// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <cstddef>
#include <string>

#include "mgsfm/base/context.h"
#include "mgsfm/database/feature_database.h"
#include "mgsfm/matching/matching_options.h"
#include "mgsfm/scene/scene.h"

namespace mgsfm {

// Matching and geometric verification of the features in a database. The
// functions differ in the image pairs they select. `scene` is the scene of the
// database (FeatureDatabase::ReadStructure and LoadScene); its frames and
// sensors guide the selection.
//
// Pairs with a two-view geometry in the database are skipped; pairs that have
// only matches are verified. Results are written in transactions of at most 256
// pairs, so an interrupted run resumes where it stopped. Results depend on
// images, image names, options and seed, not on ids, processing order or
// threads. All functions throw Error, naming the image or pair, if keypoints,
// descriptors and matches are inconsistent.

struct PairMatchingSummary {
  size_t num_pairs = 0;     // selected pairs
  size_t num_done = 0;      // already in the database
  size_t num_verified = 0;  // of num_pairs, with min_num_inliers inliers
};

// All image pairs, in blocks that share the feature cache.
PairMatchingSummary MatchExhaustively(FeatureDatabase* database,
                                      const Scene& scene,
                                      const ExhaustiveMatchingOptions& options,
                                      const PairMatchingOptions& matching,
                                      const Context& context);

// Image pairs of one camera within `overlap` frames; pairs of rig cameras that
// are found to overlap; and loops: pairs of frames more than 2 * `overlap`
// frames apart in a sequence, or of different sequences.
PairMatchingSummary MatchSequentially(FeatureDatabase* database,
                                      const Scene& scene,
                                      const SequentialMatchingOptions& options,
                                      const VocabularyOptions& vocabulary,
                                      const PairMatchingOptions& matching,
                                      const Context& context);

// The most similar frames by visual words.
PairMatchingSummary MatchByVocabulary(FeatureDatabase* database,
                                      const Scene& scene,
                                      const VocabTreeMatchingOptions& options,
                                      const VocabularyOptions& vocabulary,
                                      const PairMatchingOptions& matching,
                                      const Context& context);

// The nearest images by position prior. Throws Error if the database has none.
PairMatchingSummary MatchSpatially(FeatureDatabase* database,
                                   const Scene& scene,
                                   const SpatialMatchingOptions& options,
                                   const PairMatchingOptions& matching,
                                   const Context& context);

// The pairs or matches of a text file in COLMAP's format (match_list.h in src).
// Pairs in the database are left unchanged. Throws Error, naming the line or
// pair, for bad input; the database is not changed in this case.
PairMatchingSummary ImportMatches(FeatureDatabase* database, const Scene& scene,
                                  const std::string& match_list_path,
                                  MatchListType type,
                                  const PairMatchingOptions& matching,
                                  const Context& context);

// All pairs with matches in the database, of any kind of features; descriptors
// are not used.
PairMatchingSummary VerifyMatches(FeatureDatabase* database, const Scene& scene,
                                  const PairMatchingOptions& matching,
                                  const Context& context);

}  // namespace mgsfm

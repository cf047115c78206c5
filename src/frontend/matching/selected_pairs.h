// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <string>

#include "matching/pair_selection.h"
#include "mgsfm/base/context.h"
#include "mgsfm/database/feature_database.h"
#include "mgsfm/matching/matching_options.h"
#include "mgsfm/scene/scene.h"

namespace mgsfm {

// The pairs that the functions of matching.h match, without matching them. They
// depend on features, positions, names and options only, so that processes that
// match a share each agree on them.

ImagePairList SelectExhaustively(const Scene& scene);

// Matches the probe pairs in a temporary file, to learn which cameras overlap.
ImagePairList SelectSequentially(const FeatureDatabase& database,
                                 const Scene& scene,
                                 const SequentialMatchingOptions& options,
                                 const VocabularyOptions& vocabulary,
                                 const PairMatchingOptions& matching,
                                 const Context& context);

// Loops of sequential matching; nearer frames are not retrieved.
ImagePairList SelectLoops(const FeatureDatabase& database, const Scene& scene,
                          const SequentialMatchingOptions& options,
                          const VocabularyOptions& vocabulary,
                          const Context& context);

ImagePairList SelectByVocabulary(const FeatureDatabase& database,
                                 const Scene& scene,
                                 const VocabTreeMatchingOptions& options,
                                 const VocabularyOptions& vocabulary,
                                 const Context& context);

// Throws Error if the database has no position priors.
ImagePairList SelectSpatially(const FeatureDatabase& database,
                              const Scene& scene,
                              const SpatialMatchingOptions& options,
                              const Context& context);

// The pairs of a file (match_list.h).
ImagePairList SelectListed(const Scene& scene, const std::string& list_path);
// Writes such a file.
void WritePairList(const ImagePairList& pairs, const Scene& scene,
                   const std::string& list_path);

// All pairs with matches.
ImagePairList SelectMatched(const FeatureDatabase& database,
                            const Scene& scene);

}  // namespace mgsfm

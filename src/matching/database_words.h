// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <vector>

#include "mgsfm/base/context.h"
#include "mgsfm/io/database/feature_database.h"
#include "mgsfm/matching/vocabulary.h"
#include "mgsfm/matching/word_index.h"
#include "mgsfm/scene/scene.h"

namespace mgsfm::internal {

struct ImageWords {
  int num_words = 0;
  std::vector<WordImage> images;  // of the scene
};

// Makes a vocabulary of a sample of all descriptors and finds the words of the
// max_num_features largest features of each image (-1: of all).
ImageWords FindImageWords(const FeatureDatabase& database, const Scene& scene,
                          const VocabularyOptions& options,
                          int max_num_features, const Context& context);

}  // namespace mgsfm::internal

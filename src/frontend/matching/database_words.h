// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <optional>
#include <vector>

#include "matching/vocabulary.h"
#include "matching/word_index.h"
#include "mgsfm/base/context.h"
#include "mgsfm/database/feature_database.h"
#include "mgsfm/scene/scene.h"

namespace mgsfm::internal {

struct ImageWords {
  int num_words = 0;
  std::vector<WordImage> images;  // per image of the scene
};

// Trains a vocabulary on a sample of the max_num_features largest features (-1:
// all) of the images. nullopt if they have none.
std::optional<Vocabulary> TrainVocabulary(
    const FeatureDatabase& database, const Scene& scene,
    const VocabularyTrainingOptions& options, int max_num_features,
    const Context& context);

// Reads or trains the vocabulary and assigns words to the max_num_features
// largest features of each image (-1: to all features).
ImageWords FindImageWords(const FeatureDatabase& database, const Scene& scene,
                          const VocabularyOptions& options,
                          int max_num_features, const Context& context);

}  // namespace mgsfm::internal

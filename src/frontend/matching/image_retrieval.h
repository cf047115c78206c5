// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <cstddef>
#include <optional>
#include <vector>

#include "matching/pair_selection.h"
#include "matching/vocabulary.h"
#include "mgsfm/base/context.h"
#include "mgsfm/database/feature_database.h"
#include "mgsfm/scene/scene.h"

namespace mgsfm {

// A feature in image retrieval.
struct WordFeature {
  int word = 0;
  float x_px = 0.0f;
  float y_px = 0.0f;
  float log2_scale = 0.0f;
  float orientation_rad = 0.0f;
};

struct WordImage {
  std::vector<WordFeature> features;  // sorted by word
  float diagonal_px = 0.0f;
};

// Inverted index from visual words to images.
class WordIndex {
 public:
  WordIndex(int num_words, const std::vector<WordImage>& images);

  size_t num_images() const { return words_.size(); }

  // Similarity of all images to one image, in [0, 1]: the cosine of the tf-idf
  // vectors with the elements
  //   sqrt(features of the word in the image) log((images + 1) / images with
  //   it).
  // The square root accounts for bursts of words (Jegou, Douze, Schmid: On the
  // burstiness of visual elements, CVPR 2009). Linear in the lengths of the
  // lists of the image's words.
  std::vector<float> Similarities(size_t image_idx) const;

 private:
  struct Entry {
    int image_idx;
    float weight;
  };
  struct WordWeight {
    int word;
    float weight;
  };
  std::vector<size_t> offsets_;  // of the list of each word in entries_
  std::vector<Entry> entries_;
  std::vector<std::vector<WordWeight>> words_;  // per image
};

// Spatial verification: the number of common words whose keypoints agree on one
// similarity of the image plane, within 5 % of the diagonal, a factor of 2 in
// scale and 30 degrees. Hypotheses are the similarities of single feature pairs
// of rare words; the best one counts. O(c^2) for c <= 256 pairs of such
// features.
int CountConsistentWords(const WordImage& image1, const WordImage& image2);

struct ImageWords {
  int num_words = 0;
  std::vector<WordImage> images;  // per image of the scene
};

// Trains a vocabulary on a sample of the max_num_features largest features (-1:
// all) of the images. nullopt without features.
std::optional<Vocabulary> TrainVocabulary(
    const FeatureDatabase& database, const Scene& scene,
    const VocabularyTrainingOptions& options, int max_num_features,
    const Context& context);

// Reads or trains the vocabulary and assigns words to the max_num_features
// largest features of each image (-1: to all features).
ImageWords FindImageWords(const FeatureDatabase& database, const Scene& scene,
                          const VocabularyOptions& options,
                          int max_num_features, const Context& context);

struct FrameRetrievalOptions {
  int period = 1;
  int num_images = 50;
  int num_images_after_verification = 10;
  // Minimum distance of two frames of one sequence; 0 also allows images of the
  // same frame.
  int min_frame_distance = 0;
};

// Retrieves similar frames by visual words. Every period-th frame of a sequence
// is a query, which is compared with all other frames as a rigid unit: the
// similarity of two frames is the sum over their image pairs, so that cameras
// vote jointly. The num_images most similar frames are ranked by spatially
// consistent words over all image pairs; the first
// num_images_after_verification (0: all) are kept. Their image pairs with
// enough consistent words are selected. `images` belong to `index`.
ImagePairList RetrievePairs(const std::vector<FrameSequence>& sequences,
                            const std::vector<WordImage>& images,
                            const WordIndex& index,
                            const FrameRetrievalOptions& options,
                            const Context& context);

}  // namespace mgsfm

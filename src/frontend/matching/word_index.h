// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <cstddef>
#include <vector>

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

  // Similarity of all images to one of them, in [0, 1]: the cosine of the
  // tf-idf vectors with the elements
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
// scale and 30 degrees. Hypotheses are the similarities of single features of
// rare words; the best one counts. O(c^2) for c <= 256 pairs of such features.
int CountConsistentWords(const WordImage& image1, const WordImage& image2);

}  // namespace mgsfm

// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <cstddef>
#include <vector>

namespace mgsfm {

// A feature as retrieval sees it.
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

// Which words are in which images, to find images like one of them.
class WordIndex {
 public:
  WordIndex(int num_words, const std::vector<WordImage>& images);

  size_t num_images() const { return words_.size(); }

  // Of each image to one of them, in [0, 1]: the cosine of the vectors with the
  // elements
  //   sqrt(features of the word in the image) log((images + 1) / images with
  //   it),
  // (the square root because words come in bursts; Jegou et al. 2009). Linear
  // in the entries of the lists of the image's words.
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
  std::vector<std::vector<WordWeight>> words_;  // of each image
};

// Words that both images show at places that one similarity of the image plane
// maps onto each other: roughly, within 5 % of the diagonal, a factor of 2 in
// scale and 30 degrees. The largest number over the similarities that single
// features of rare words give. O(c^2) for c <= 256 pairs of such features.
int CountConsistentWords(const WordImage& image1, const WordImage& image2);

}  // namespace mgsfm

// SPDX-License-Identifier: BSD-3-Clause
#include "matching/word_index.h"

#include <algorithm>
#include <cmath>
#include <optional>

#include "geometry/so3.h"

namespace mgsfm {
namespace {

// A word is rare if at most this many pairs of its features in the two images
// may be corresponding points: two features in each, for example.
constexpr size_t kMaxNumPairsOfWord = 4;
// Bounds the quadratic cost of spatial verification.
constexpr size_t kMaxNumPairs = 256;
// A similarity only approximates the change of perspective; see word_index.h.
// Precision and recall with these values: docs/results/constants.md.
constexpr float kMaxDistance = 0.05f;  // relative to the diagonal
constexpr float kMaxLog2Scale = 1.0f;
constexpr float kMaxRotationRad = 0.5236f;  // 30 degrees

// Calls visit(word, begin, end) for the range of features of each word.
template <class Visit>
void ForEachWord(const std::vector<WordFeature>& features, const Visit& visit) {
  for (size_t begin = 0, end = 0; begin < features.size(); begin = end) {
    while (end < features.size() &&
           features[end].word == features[begin].word) {
      ++end;
    }
    visit(features[begin].word, begin, end);
  }
}

struct FeaturePair {
  const WordFeature* feature1;
  const WordFeature* feature2;

  float Log2Scale() const {
    return feature2->log2_scale - feature1->log2_scale;
  }
  float RotationRad() const {
    return feature2->orientation_rad - feature1->orientation_rad;
  }
};

// Pairs of features of words that are rare in both images, sorted by word.
std::vector<FeaturePair> PairsOfWords(const WordImage& image1,
                                      const WordImage& image2) {
  const std::vector<WordFeature>& features2 = image2.features;
  std::vector<FeaturePair> pairs;
  size_t begin2 = 0;
  ForEachWord(image1.features, [&](int word, size_t begin1, size_t end1) {
    while (begin2 < features2.size() && features2[begin2].word < word) ++begin2;
    size_t end2 = begin2;
    while (end2 < features2.size() && features2[end2].word == word) ++end2;
    if ((end1 - begin1) * (end2 - begin2) > kMaxNumPairsOfWord) return;
    for (size_t i = begin1; i < end1; ++i) {
      for (size_t j = begin2; j < end2; ++j) {
        pairs.push_back({&image1.features[i], &features2[j]});
      }
    }
  });
  if (pairs.size() <= kMaxNumPairs) return pairs;
  // Select pairs at equal spacing.
  std::vector<FeaturePair> selected(kMaxNumPairs);
  for (size_t i = 0; i < kMaxNumPairs; ++i) {
    selected[i] = pairs[i * pairs.size() / kMaxNumPairs];
  }
  return selected;
}

// The similarity of the image plane that maps feature1 to feature2.
class Similarity {
 public:
  Similarity(const FeaturePair& pair, float max_distance)
      : log2_scale_(pair.Log2Scale()),
        rotation_rad_(pair.RotationRad()),
        max_squared_distance_(max_distance * max_distance) {
    const float scale = std::exp2(log2_scale_);
    cos_ = scale * std::cos(rotation_rad_);
    sin_ = scale * std::sin(rotation_rad_);
    x_ = pair.feature2->x_px - RotatedX(*pair.feature1);
    y_ = pair.feature2->y_px - RotatedY(*pair.feature1);
  }

  bool Agrees(const FeaturePair& pair) const {
    const float x = RotatedX(*pair.feature1) + x_ - pair.feature2->x_px;
    const float y = RotatedY(*pair.feature1) + y_ - pair.feature2->y_px;
    if (!(x * x + y * y <= max_squared_distance_)) return false;
    if (std::abs(pair.Log2Scale() - log2_scale_) > kMaxLog2Scale) return false;
    constexpr auto kTwoPi = static_cast<float>(2.0 * kPi);
    return std::abs(std::remainder(pair.RotationRad() - rotation_rad_,
                                   kTwoPi)) <= kMaxRotationRad;
  }

 private:
  float RotatedX(const WordFeature& feature) const {
    return cos_ * feature.x_px - sin_ * feature.y_px;
  }
  float RotatedY(const WordFeature& feature) const {
    return sin_ * feature.x_px + cos_ * feature.y_px;
  }

  float log2_scale_;
  float rotation_rad_;
  float max_squared_distance_;
  float cos_, sin_;
  float x_, y_;
};

}  // namespace

WordIndex::WordIndex(int num_words, const std::vector<WordImage>& images)
    : offsets_(static_cast<size_t>(num_words) + 1, 0), words_(images.size()) {
  for (const WordImage& image : images) {
    ForEachWord(image.features,
                [&](int word, size_t, size_t) { ++offsets_[word + 1]; });
  }
  std::vector<float> idf(num_words, 0.0f);
  for (int word = 0; word < num_words; ++word) {
    const double num_with_word = static_cast<double>(offsets_[word + 1]);
    if (num_with_word > 0.0) {
      idf[word] = static_cast<float>(
          std::log((static_cast<double>(images.size()) + 1.0) / num_with_word));
    }
    offsets_[word + 1] += offsets_[word];
  }
  entries_.resize(offsets_.back());
  std::vector<size_t> next(offsets_.begin(), offsets_.end() - 1);
  for (size_t i = 0; i < images.size(); ++i) {
    float squared_norm = 0.0f;
    ForEachWord(images[i].features, [&](int word, size_t begin, size_t end) {
      const float weight =
          std::sqrt(static_cast<float>(end - begin)) * idf[word];
      words_[i].push_back({word, weight});
      squared_norm += weight * weight;
    });
    const float scale =
        squared_norm > 0.0f ? 1.0f / std::sqrt(squared_norm) : 0.0f;
    for (WordWeight& word : words_[i]) {
      word.weight *= scale;
      entries_[next[word.word]++] = {static_cast<int>(i), word.weight};
    }
  }
}

std::vector<float> WordIndex::Similarities(size_t image_idx) const {
  std::vector<float> similarities(num_images(), 0.0f);
  for (const WordWeight& word : words_[image_idx]) {
    for (size_t k = offsets_[word.word]; k < offsets_[word.word + 1]; ++k) {
      similarities[entries_[k].image_idx] += word.weight * entries_[k].weight;
    }
  }
  return similarities;
}

int CountConsistentWords(const WordImage& image1, const WordImage& image2) {
  const std::vector<FeaturePair> pairs = PairsOfWords(image1, image2);
  int most = 0;
  for (const FeaturePair& start : pairs) {
    const Similarity similarity(start, kMaxDistance * image2.diagonal_px);
    int num_words = 0;
    std::optional<int> last_word;
    for (const FeaturePair& pair : pairs) {
      const int word = pair.feature1->word;
      if (word == last_word || !similarity.Agrees(pair)) continue;
      ++num_words;
      last_word = word;
    }
    most = std::max(most, num_words);
  }
  return most;
}

}  // namespace mgsfm

// SPDX-License-Identifier: BSD-3-Clause
#include "matching/image_retrieval.h"

#include <algorithm>
#include <cmath>
#include <cstdlib>
#include <optional>

#include "base/parallel.h"
#include "base/random.h"
#include "base/ranges.h"
#include "geometry/so3.h"
#include "matching/pair_selection.h"
#include "matching/scene_pairs.h"

namespace mgsfm {
namespace {

// A word is rare if at most this many pairs of its features in the two images
// may be corresponding points: two features in each, for example.
constexpr size_t kMaxNumPairsOfWord = 4;
// Bounds the quadratic cost of spatial verification.
constexpr size_t kMaxNumPairs = 256;
// A similarity only approximates the change of perspective (see the header).
// docs/results/constants.md has precision and recall with these values.
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
  return EvenlySpaced(pairs, kMaxNumPairs);
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

namespace {

// Number of images in memory at a time; 67 MB of descriptors at 8192
// features each.
constexpr size_t kChunkSize = 64;

// The largest features of an image, in database order.
struct LargestFeatures {
  std::vector<FeatureKeypoint> keypoints;
  std::vector<uint8_t> descriptors;

  DescriptorView View() const { return {descriptors.data(), keypoints.size()}; }
};

LargestFeatures ReadLargest(const FeatureDatabase& database, const Image& image,
                            int max_num_features) {
  const std::vector<FeatureKeypoint> keypoints =
      database.ReadKeypoints(image.id);
  const DescriptorMatrix descriptors =
      ReadSiftDescriptors(database, image, keypoints.size());
  std::vector<size_t> order = Indices<size_t>(keypoints.size());
  const auto max_size = static_cast<size_t>(max_num_features);
  if (max_num_features >= 0 && order.size() > max_size) {
    StableSortDescendingBy(&order,
                           [&](size_t a) { return keypoints[a].ScalePx(); });
    order.resize(max_size);
    std::sort(order.begin(), order.end());
  }
  LargestFeatures features;
  for (const size_t i : order) {
    features.keypoints.push_back(keypoints[i]);
    const uint8_t* row = descriptors.data() + i * DescriptorView::kDim;
    features.descriptors.insert(features.descriptors.end(), row,
                                row + DescriptorView::kDim);
  }
  return features;
}

// Samples the same number of descriptors from each image, or all if it has
// fewer.
std::vector<uint8_t> SampleDescriptors(const FeatureDatabase& database,
                                       const Scene& scene,
                                       const VocabularyTrainingOptions& options,
                                       int max_num_features,
                                       const Context& context) {
  const size_t num_images = scene.images.size();
  const size_t quota = std::max<size_t>(
      1, static_cast<size_t>(options.max_num_descriptors) / num_images);
  std::vector<uint8_t> samples;
  for (size_t i = 0; i < num_images; ++i) {
    context.ReportProgress("reading descriptors", i, num_images);
    const LargestFeatures features =
        ReadLargest(database, scene.images[i], max_num_features);
    std::vector<size_t> order = Indices<size_t>(features.keypoints.size());
    const size_t num_drawn = std::min(quota, order.size());
    Random random(context.random_seed, i);
    for (size_t k = 0; k < num_drawn; ++k) {
      const size_t drawn =
          k + random.Index(static_cast<uint32_t>(order.size() - k));
      std::swap(order[k], order[drawn]);
      const uint8_t* row = features.View().Row(order[k]);
      samples.insert(samples.end(), row, row + DescriptorView::kDim);
    }
  }
  context.ReportProgress("reading descriptors", num_images, num_images);
  return samples;
}

WordImage MakeWordImage(const Vocabulary& vocabulary,
                        const LargestFeatures& features, const Camera& camera) {
  WordImage image;
  image.diagonal_px = static_cast<float>(
      std::hypot(static_cast<double>(camera.width_px), camera.height_px));
  for (size_t i = 0; i < features.keypoints.size(); ++i) {
    const FeatureKeypoint& keypoint = features.keypoints[i];
    constexpr float kMinScalePx = 1e-3f;  // keypoints may have no scale
    image.features.push_back(
        {vocabulary.FindWord(features.View().Row(i)), keypoint.x_px,
         keypoint.y_px, std::log2(std::max(keypoint.ScalePx(), kMinScalePx)),
         keypoint.OrientationRad()});
  }
  StableSortBy(&image.features, &WordFeature::word);
  return image;
}

}  // namespace

std::optional<Vocabulary> TrainVocabulary(
    const FeatureDatabase& database, const Scene& scene,
    const VocabularyTrainingOptions& options, int max_num_features,
    const Context& context) {
  const std::vector<uint8_t> samples =
      SampleDescriptors(database, scene, options, max_num_features, context);
  if (samples.empty()) return std::nullopt;
  return Vocabulary::Train(
      {samples.data(), samples.size() / DescriptorView::kDim}, options,
      context);
}

ImageWords FindImageWords(const FeatureDatabase& database, const Scene& scene,
                          const VocabularyOptions& options,
                          int max_num_features, const Context& context) {
  ImageWords words;
  words.images.resize(scene.images.size());
  const std::optional<Vocabulary> vocabulary =
      options.vocab_tree_path->empty()
          ? TrainVocabulary(database, scene, options, max_num_features, context)
          : Vocabulary::Read(options.vocab_tree_path);
  if (!vocabulary) return words;
  words.num_words = vocabulary->num_words();
  for (size_t begin = 0; begin < words.images.size(); begin += kChunkSize) {
    const size_t end = std::min(begin + kChunkSize, words.images.size());
    std::vector<LargestFeatures> chunk;
    for (size_t i = begin; i < end; ++i) {
      chunk.push_back(ReadLargest(database, scene.images[i], max_num_features));
    }
    ParallelFor(
        chunk.size(), context.num_threads,
        [&](size_t k) {
          const Image& image = scene.images[begin + k];
          words.images[begin + k] = MakeWordImage(
              *vocabulary, chunk[k], scene.cameras[image.camera_idx]);
        },
        1);
    context.ReportProgress("assigning visual words", end, words.images.size());
  }
  return words;
}

namespace {

// Minimum similarity of an image pair relative to the most similar pair of its
// two frames; less similar pairs are skipped to save time. This value skips 1
// of 1178 pairs that would be verified, twice the value 291
// (docs/results/constants.md).
constexpr float kMinRelativeSimilarity = 0.25f;
// Image pairs with fewer consistent words are rejected. Unrelated images in
// tests/frontend/matching/vocabulary_test.cc have at most this many by chance.
constexpr int kMinConsistentWords = 6;

// A frame as an index in a sequence.
struct Place {
  size_t sequence = 0;
  int frame = 0;
  std::vector<int> images;
};

struct Candidate {
  size_t place = 0;
  float similarity = 0.0f;
  int num_consistent = 0;
  ImagePairList pairs;
};

class FrameRetrieval {
 public:
  FrameRetrieval(const std::vector<FrameSequence>& sequences,
                 const std::vector<WordImage>& images, const WordIndex& index,
                 const FrameRetrievalOptions& options)
      : images_(images), index_(index), options_(options) {
    for (size_t s = 0; s < sequences.size(); ++s) {
      for (int i = 0; i < sequences[s].num_frames(); ++i) {
        Place place{s, i, {}};
        for (const std::optional<int>& image : sequences[s].images[i]) {
          if (image) place.images.push_back(*image);
        }
        if (i % options.period == 0) queries_.push_back(places_.size());
        places_.push_back(std::move(place));
      }
    }
  }

  size_t num_queries() const { return queries_.size(); }

  ImagePairList Query(size_t query_idx) const {
    const Place& query = places_[queries_[query_idx]];
    const std::vector<std::vector<float>> similarities = Transformed(
        query.images, [&](int image) { return index_.Similarities(image); });
    std::vector<Candidate> candidates = MostSimilar(query, similarities);
    for (Candidate& candidate : candidates) {
      Compare(query, similarities, &candidate);
    }
    if (options_.num_images_after_verification > 0) {
      KeepFirst(options_.num_images_after_verification,
                &Candidate::num_consistent, &candidates);
    }
    return Concatenated(Transformed(candidates, &Candidate::pairs));
  }

 private:
  bool IsCandidate(const Place& query, const Place& place) const {
    return query.sequence != place.sequence ||
           std::abs(query.frame - place.frame) >= options_.min_frame_distance;
  }

  std::vector<Candidate> MostSimilar(
      const Place& query,
      const std::vector<std::vector<float>>& similarities) const {
    std::vector<Candidate> candidates;
    for (size_t p = 0; p < places_.size(); ++p) {
      if (!IsCandidate(query, places_[p])) continue;
      Candidate candidate{p, 0.0f, 0, {}};
      for (size_t i = 0; i < query.images.size(); ++i) {
        for (const int other : places_[p].images) {
          if (other != query.images[i]) {
            candidate.similarity += similarities[i][other];
          }
        }
      }
      if (candidate.similarity > 0.0f) candidates.push_back(candidate);
    }
    KeepFirst(options_.num_images, &Candidate::similarity, &candidates);
    return candidates;
  }

  // Selects image pairs of the two frames.
  void Compare(const Place& query,
               const std::vector<std::vector<float>>& similarities,
               Candidate* candidate) const {
    const std::vector<int>& others = places_[candidate->place].images;
    float most_similar = 0.0f;
    for (size_t i = 0; i < query.images.size(); ++i) {
      for (const int other : others) {
        if (other == query.images[i]) continue;
        most_similar = std::max(most_similar, similarities[i][other]);
      }
    }
    for (size_t i = 0; i < query.images.size(); ++i) {
      const int image = query.images[i];
      for (const int other : others) {
        if (other == image ||
            similarities[i][other] < kMinRelativeSimilarity * most_similar) {
          continue;
        }
        if (options_.num_images_after_verification > 0) {
          const int num_consistent =
              CountConsistentWords(images_[image], images_[other]);
          if (num_consistent < kMinConsistentWords) continue;
          candidate->num_consistent += num_consistent;
        }
        candidate->pairs.push_back(MakePair(image, other));
      }
    }
  }

  // Keeps the candidates with the largest values; ties go to the first.
  template <class Value>
  static void KeepFirst(int num_kept, Value Candidate::*value,
                        std::vector<Candidate>* candidates) {
    StableSortDescendingBy(candidates, value);
    if (candidates->size() > static_cast<size_t>(num_kept)) {
      candidates->resize(num_kept);
    }
  }

  const std::vector<WordImage>& images_;
  const WordIndex& index_;
  const FrameRetrievalOptions& options_;
  std::vector<Place> places_;
  std::vector<size_t> queries_;
};

}  // namespace

ImagePairList RetrievePairs(const std::vector<FrameSequence>& sequences,
                            const std::vector<WordImage>& images,
                            const WordIndex& index,
                            const FrameRetrievalOptions& options,
                            const Context& context) {
  const FrameRetrieval retrieval(sequences, images, index, options);
  std::vector<ImagePairList> pairs_of_query(retrieval.num_queries());
  ParallelFor(pairs_of_query.size(), context, "image retrieval",
              [&](size_t i) { pairs_of_query[i] = retrieval.Query(i); });
  ImagePairList pairs = Concatenated(pairs_of_query);
  SortUnique(&pairs);
  return pairs;
}

}  // namespace mgsfm

// SPDX-License-Identifier: BSD-3-Clause
#include "matching/database_words.h"

#include <algorithm>
#include <cmath>
#include <numeric>

#include "base/parallel.h"
#include "base/random.h"
#include "matching/feature_cache.h"

namespace mgsfm::internal {
namespace {

// Number of images in memory at a time; 67 MB of descriptors at 8192
// features each.
constexpr size_t kChunkSize = 64;

// The largest features of an image, in their order in the database.
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
  std::vector<size_t> order(keypoints.size());
  std::iota(order.begin(), order.end(), size_t{0});
  const auto max_size = static_cast<size_t>(max_num_features);
  if (max_num_features >= 0 && order.size() > max_size) {
    std::stable_sort(order.begin(), order.end(), [&](size_t a, size_t b) {
      return keypoints[a].ScalePx() > keypoints[b].ScalePx();
    });
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
    std::vector<size_t> order(features.keypoints.size());
    std::iota(order.begin(), order.end(), size_t{0});
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
  std::stable_sort(image.features.begin(), image.features.end(),
                   [](const WordFeature& a, const WordFeature& b) {
                     return a.word < b.word;
                   });
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

}  // namespace mgsfm::internal

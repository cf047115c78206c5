// SPDX-License-Identifier: BSD-3-Clause
#include "matching/vocabulary.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <set>
#include <string>

#include "frontend/matching/test_descriptors.h"
#include "matching/image_retrieval.h"
#include "matching/pair_selection.h"
#include "mgsfm/base/error.h"
#include "support/temp_dir.h"

namespace mgsfm {
namespace {

std::vector<int> WordsOf(const Vocabulary& vocabulary,
                         const TestDescriptors& descriptors) {
  std::vector<int> words;
  for (size_t i = 0; i < descriptors.size(); ++i) {
    words.push_back(vocabulary.FindWord(descriptors.View().Row(i)));
  }
  return words;
}

TEST(Vocabulary, NumberOfWordsFollowsTheOptions) {
  Random random(1);
  const TestDescriptors samples = RandomDescriptors(4000, &random);
  VocabularyOptions options;
  for (const int num_words : {1, 20, 200}) {
    options.num_visual_words = num_words;
    const auto vocabulary = Vocabulary::Train(samples.View(), options, {});
    EXPECT_GE(vocabulary.num_words(), num_words / 2);
    EXPECT_LE(vocabulary.num_words(), 2 * num_words);
    const std::vector<int> words = WordsOf(vocabulary, samples);
    EXPECT_GE(*std::min_element(words.begin(), words.end()), 0);
    EXPECT_LT(*std::max_element(words.begin(), words.end()),
              vocabulary.num_words());
  }
}

TEST(Vocabulary, WellSeparatedClustersAreWords) {
  Random random(2);
  const TestDescriptors centers = RandomDescriptors(12, &random);
  TestDescriptors samples;
  for (int i = 0; i < 600; ++i) {
    samples.AddNoisyCopy(centers.View().Row(i % 12), 2.0, &random);
  }
  VocabularyOptions options;
  options.num_visual_words = 40;
  const auto vocabulary = Vocabulary::Train(samples.View(), options, {});
  // No word has samples of two clusters.
  const std::vector<int> words = WordsOf(vocabulary, samples);
  std::set<std::pair<int, size_t>> clusters_of_words;
  std::set<int> distinct_words;
  for (size_t i = 0; i < words.size(); ++i) {
    clusters_of_words.emplace(words[i], i % 12);
    distinct_words.insert(words[i]);
  }
  EXPECT_LE(clusters_of_words.size(), distinct_words.size() + 2);
}

TEST(Vocabulary, DoesNotDependOnThreads) {
  Random random(3);
  const TestDescriptors samples = RandomDescriptors(3000, &random);
  Context context;
  context.random_seed = 5;
  const auto reference = Vocabulary::Train(samples.View(), {}, context);
  context.num_threads = 3;
  const auto parallel = Vocabulary::Train(samples.View(), {}, context);
  EXPECT_EQ(WordsOf(reference, samples), WordsOf(parallel, samples));
  context.random_seed = 6;
  const auto other = Vocabulary::Train(samples.View(), {}, context);
  EXPECT_NE(WordsOf(reference, samples), WordsOf(other, samples));
}

TEST(Vocabulary, EqualSamplesAreOneWord) {
  TestDescriptors samples;
  samples.values.assign(100 * DescriptorView::kDim, 40);
  const auto vocabulary = Vocabulary::Train(samples.View(), {}, {});
  EXPECT_EQ(vocabulary.num_words(), 1);
  TestDescriptors single;
  single.values.assign(DescriptorView::kDim, 7);
  EXPECT_EQ(Vocabulary::Train(single.View(), {}, {}).num_words(), 1);
}

TEST(Vocabulary, FilesKeepTheWords) {
  const TempDir dir;
  const std::string path = (dir.path() / "tree.bin").string();
  Random random(4);
  const TestDescriptors samples = RandomDescriptors(3000, &random);
  const auto vocabulary = Vocabulary::Train(samples.View(), {}, {});
  vocabulary.Write(path);
  const auto copy = Vocabulary::Read(path);
  EXPECT_EQ(copy.num_words(), vocabulary.num_words());
  EXPECT_EQ(WordsOf(copy, samples), WordsOf(vocabulary, samples));
  // No damaged file is a tree whose paths do not end.
  const TestDescriptors queries = RandomDescriptors(20, &random);
  const std::string bytes = ReadTextFile(path);
  for (int trial = 0; trial < 200; ++trial) {
    std::string damaged = bytes;
    const size_t at = random.Index(static_cast<uint32_t>(
        trial % 2 == 0 ? std::min<size_t>(2000, bytes.size()) : bytes.size()));
    if (trial % 3 == 0) damaged.resize(at);
    if (at < damaged.size()) {
      damaged[at] = static_cast<char>(random.Index(256));
    }
    WriteTextFile(path, damaged);
    try {
      const auto tree = Vocabulary::Read(path);
      for (const int word : WordsOf(tree, queries)) {
        ASSERT_LT(word, tree.num_words());
      }
    } catch (const Error& error) {
      EXPECT_NE(std::string(error.what()).find(path), std::string::npos);
    }
  }
}

// Images of places. Each place has features at fixed positions; an image shows
// most of them, transformed by a similarity with noise, and some others.
class World {
 public:
  World(int num_places, Random* random) {
    for (int i = 0; i < num_places; ++i) {
      descriptors_.push_back(RandomDescriptors(kNumFeatures, random));
      std::vector<WordFeature>& features = features_.emplace_back();
      for (size_t k = 0; k < kNumFeatures; ++k) {
        features.push_back({0, static_cast<float>(random->Uniform(0, 800)),
                            static_cast<float>(random->Uniform(0, 600)),
                            static_cast<float>(random->Uniform(0, 4)),
                            static_cast<float>(random->Uniform(-3, 3))});
      }
    }
  }

  TestDescriptors AllDescriptors() const {
    TestDescriptors all;
    for (const TestDescriptors& place : descriptors_) {
      all.values.insert(all.values.end(), place.values.begin(),
                        place.values.end());
    }
    return all;
  }

  WordImage Take(int place, const Vocabulary& vocabulary,
                 Random* random) const {
    const double scale = random->Uniform(0.8, 1.25);
    const double rotation_rad = random->Uniform(-0.3, 0.3);
    WordImage image;
    image.diagonal_px = 1000.0f;
    for (size_t k = 0; k < kNumFeatures; ++k) {
      WordFeature feature = features_[place][k];
      TestDescriptors descriptor;
      if (random->Uniform() < 0.6) {
        descriptor.AddNoisyCopy(descriptors_[place].View().Row(k), 4.0, random);
        const double x = feature.x_px, y = feature.y_px;
        feature.x_px = static_cast<float>(
            scale * (std::cos(rotation_rad) * x - std::sin(rotation_rad) * y) +
            20.0 + 5.0 * random->Normal());
        feature.y_px = static_cast<float>(
            scale * (std::sin(rotation_rad) * x + std::cos(rotation_rad) * y) -
            30.0 + 5.0 * random->Normal());
        feature.log2_scale += static_cast<float>(std::log2(scale));
        feature.orientation_rad += static_cast<float>(rotation_rad);
      } else {
        descriptor.AddRandom(random);
      }
      feature.word = vocabulary.FindWord(descriptor.View().Row(0));
      image.features.push_back(feature);
    }
    std::stable_sort(image.features.begin(), image.features.end(),
                     [](const WordFeature& a, const WordFeature& b) {
                       return a.word < b.word;
                     });
    return image;
  }

 private:
  static constexpr size_t kNumFeatures = 150;
  std::vector<TestDescriptors> descriptors_;
  std::vector<std::vector<WordFeature>> features_;
};

// Two visits to each of 30 places.
struct Visits {
  std::vector<WordImage> images;
  int num_words = 0;

  explicit Visits(int num_visits, Random* random) {
    const World world(kNumPlaces, random);
    const auto vocabulary =
        Vocabulary::Train(world.AllDescriptors().View(), {}, {});
    num_words = vocabulary.num_words();
    for (int visit = 0; visit < num_visits; ++visit) {
      for (int place = 0; place < kNumPlaces; ++place) {
        images.push_back(world.Take(place, vocabulary, random));
      }
    }
  }
  static constexpr int kNumPlaces = 30;
};

TEST(WordIndex, FindsTheOtherVisit) {
  Random random(4);
  const Visits visits(2, &random);
  const WordIndex index(visits.num_words, visits.images);
  for (int i = 0; i < Visits::kNumPlaces; ++i) {
    std::vector<float> similarities = index.Similarities(i);
    EXPECT_NEAR(similarities[i], 1.0f, 1e-4f);
    similarities[i] = 0.0f;
    const auto best =
        std::max_element(similarities.begin(), similarities.end());
    EXPECT_EQ(best - similarities.begin(), i + Visits::kNumPlaces);
  }
}

TEST(WordIndex, SimilarityIsSymmetric) {
  Random random(5);
  const Visits visits(1, &random);
  const WordIndex index(visits.num_words, visits.images);
  EXPECT_NEAR(index.Similarities(3)[8], index.Similarities(8)[3], 1e-6f);
}

TEST(CountConsistentWords, DistinguishesPlaces) {
  Random random(6);
  const Visits visits(2, &random);
  for (int i = 0; i < Visits::kNumPlaces; ++i) {
    const WordImage& image = visits.images[i];
    const int same =
        CountConsistentWords(image, visits.images[i + Visits::kNumPlaces]);
    const int different = CountConsistentWords(
        image, visits.images[(i + 7) % Visits::kNumPlaces]);
    EXPECT_GE(same, 20);
    EXPECT_LE(different, 6);
  }
}

TEST(CountConsistentWords, EmptyImagesShareNothing) {
  EXPECT_EQ(CountConsistentWords({}, {}), 0);
}

// One rig with two sensors: frame i has the images 2 i and 2 i + 1.
FrameSequence TwoSensorSequence(int num_frames) {
  FrameSequence sequence;
  sequence.num_slots = 2;
  for (int i = 0; i < num_frames; ++i) {
    sequence.frame_idxs.push_back(i);
    sequence.images.push_back({2 * i, 2 * i + 1});
  }
  return sequence;
}

TEST(RetrievePairs, FindsFramesOfOnePlace) {
  Random random(7);
  // 60 images are 30 frames: frame i shows places 2 i and 2 i + 1 (modulo 30),
  // so that frames i and i + 15 show the same places.
  const Visits visits(2, &random);
  const WordIndex index(visits.num_words, visits.images);
  FrameRetrievalOptions options;
  options.min_frame_distance = 5;
  Context context;
  const auto sequence = TwoSensorSequence(30);
  const ImagePairList pairs =
      RetrievePairs({sequence}, visits.images, index, options, context);
  ImagePairList expected;
  for (int i = 0; i < 30; ++i) expected.push_back({i, i + 30});
  for (const ImageIdxPair& pair : expected) {
    EXPECT_TRUE(std::binary_search(pairs.begin(), pairs.end(), pair));
  }
  EXPECT_LE(pairs.size(), expected.size() + 3);
  context.num_threads = 3;
  EXPECT_EQ(pairs,
            RetrievePairs({sequence}, visits.images, index, options, context));
}

TEST(RetrievePairs, SkipsNearFrames) {
  Random random(8);
  const Visits visits(2, &random);
  const WordIndex index(visits.num_words, visits.images);
  FrameRetrievalOptions options;
  options.min_frame_distance = 16;
  EXPECT_TRUE(
      RetrievePairs({TwoSensorSequence(30)}, visits.images, index, options, {})
          .empty());
}

TEST(RetrievePairs, QueriesEveryPeriodOnly) {
  Random random(9);
  const Visits visits(2, &random);
  const WordIndex index(visits.num_words, visits.images);
  FrameRetrievalOptions options;
  options.min_frame_distance = 5;
  options.period = 30;  // the first frame
  options.num_images_after_verification = 1;
  const ImagePairList pairs =
      RetrievePairs({TwoSensorSequence(30)}, visits.images, index, options, {});
  EXPECT_EQ(pairs, (ImagePairList{{0, 30}, {1, 31}}));
}

}  // namespace
}  // namespace mgsfm

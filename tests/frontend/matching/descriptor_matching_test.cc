// SPDX-License-Identifier: BSD-3-Clause
#include "matching/descriptor_matching.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <utility>

#include "frontend/matching/test_descriptors.h"
#include "matching/nearest_two.h"

namespace mgsfm {

inline bool operator==(const Match& a, const Match& b) {
  return a.keypoint_idx1 == b.keypoint_idx1 &&
         a.keypoint_idx2 == b.keypoint_idx2;
}

inline bool operator==(const TwoNearest& a, const TwoNearest& b) {
  return a.best_idx == b.best_idx && a.best_dot == b.best_dot &&
         a.second_dot == b.second_dot;
}

namespace {

double Angle(const uint8_t* a, const uint8_t* b) {
  double dot = 0.0;
  for (size_t k = 0; k < DescriptorView::kDim; ++k) {
    dot += static_cast<double>(a[k]) * static_cast<double>(b[k]);
  }
  return std::acos(std::min(1.0, dot / (512.0 * 512.0)));
}

// The descriptor of `to` that `from` accepts, in double precision; -1: none.
int Nearest(const uint8_t* from, DescriptorView to, double max_ratio,
            double max_distance) {
  double best = std::acos(0.0), second = std::acos(0.0);
  int best_idx = -1;
  for (size_t j = 0; j < to.size; ++j) {
    const double angle = Angle(from, to.Row(j));
    if (best_idx < 0 || angle < best) {
      if (best_idx >= 0) second = best;
      best = angle;
      best_idx = static_cast<int>(j);
    } else {
      second = std::min(second, angle);
    }
  }
  return best <= max_distance && best < max_ratio * second ? best_idx : -1;
}

std::vector<Match> BruteForce(DescriptorView a, DescriptorView b,
                              const DescriptorMatchingOptions& options) {
  std::vector<Match> matches;
  for (size_t i = 0; i < a.size; ++i) {
    const int j = Nearest(a.Row(i), b, options.max_ratio, options.max_distance);
    if (j < 0) continue;
    if (options.cross_check &&
        Nearest(b.Row(j), a, options.max_ratio, options.max_distance) !=
            static_cast<int>(i)) {
      continue;
    }
    matches.push_back({static_cast<uint32_t>(i), static_cast<uint32_t>(j)});
  }
  return matches;
}

// All instruction sets of this processor give these matches.
void ExpectBruteForce(const TestDescriptors& a, const TestDescriptors& b,
                      const DescriptorMatchingOptions& options) {
  const auto expected = BruteForce(a.View(), b.View(), options);
  for (const InstructionSet set : InstructionSets()) {
    EXPECT_EQ(MatchDescriptors(a.View(), b.View(), options, set), expected)
        << "set " << static_cast<int>(set);
  }
}

struct Sizes {
  size_t a, b;
};

class DescriptorMatchingTest : public testing::TestWithParam<Sizes> {};

TEST_P(DescriptorMatchingTest, AgreesWithBruteForceInDoubles) {
  Random random(7);
  for (const double noise : {2.0, 12.0}) {
    const TestDescriptors a = RandomDescriptors(GetParam().a, &random);
    const TestDescriptors b = PartlyMatching(a, GetParam().b, noise, &random);
    for (const bool cross_check : {true, false}) {
      DescriptorMatchingOptions options;
      options.cross_check = cross_check;
      ExpectBruteForce(a, b, options);
    }
  }
}

// Sizes around those of tiles and panels.
INSTANTIATE_TEST_SUITE_P(Sizes, DescriptorMatchingTest,
                         testing::Values(Sizes{0, 0}, Sizes{0, 5}, Sizes{5, 0},
                                         Sizes{1, 1}, Sizes{6, 16},
                                         Sizes{7, 17}, Sizes{59, 33},
                                         Sizes{61, 15}, Sizes{187, 210},
                                         Sizes{240, 160}, Sizes{250, 30},
                                         Sizes{20, 4110}));

TEST(DescriptorMatching, SwappedImagesGiveSwappedMatches) {
  Random random(3);
  const TestDescriptors a = RandomDescriptors(150, &random);
  const TestDescriptors b = PartlyMatching(a, 170, 10.0, &random);
  const DescriptorMatchingOptions options;
  const auto matches = MatchDescriptors(a.View(), b.View(), options);
  auto swapped = MatchDescriptors(b.View(), a.View(), options);
  for (Match& match : swapped)
    std::swap(match.keypoint_idx1, match.keypoint_idx2);
  std::sort(swapped.begin(), swapped.end(), [](const Match& x, const Match& y) {
    return x.keypoint_idx1 < y.keypoint_idx1;
  });
  EXPECT_GT(matches.size(), 30u);
  EXPECT_EQ(matches, swapped);
}

// Families of similar descriptors, so that many decisions are close.
TEST(DescriptorMatching, CloseDecisionsAreExact) {
  Random random(4);
  const TestDescriptors ancestors = RandomDescriptors(25, &random);
  TestDescriptors a, b;
  for (int i = 0; i < 250; ++i) {
    const double noise = random.Uniform(4.0, 24.0);
    const auto* row = ancestors.View().Row(i % ancestors.size());
    a.AddNoisyCopy(row, noise, &random);
    b.AddNoisyCopy(a.View().Row(a.size() - 1), 0.2 * noise, &random);
  }
  for (const bool cross_check : {true, false}) {
    for (const double max_ratio : {0.7, 0.9, 1.0}) {
      DescriptorMatchingOptions options;
      options.cross_check = cross_check;
      options.max_ratio = max_ratio;
      EXPECT_GE(MatchDescriptors(a.View(), b.View(), options).size(), 5u);
      ExpectBruteForce(a, b, options);
    }
  }
}

// Norms other than SIFT's: small, and so large that 16-bit sums overflow.
TEST(DescriptorMatching, AcceptsAnyNorm) {
  Random random(8);
  for (const uint32_t size : {2u, 30u, 256u}) {
    TestDescriptors a, b;
    for (auto* descriptors : {&a, &b}) {
      for (size_t k = 0; k < 60 * DescriptorView::kDim; ++k) {
        descriptors->values.push_back(static_cast<uint8_t>(random.Index(size)));
      }
    }
    DescriptorMatchingOptions options;
    options.max_ratio = 1.0;
    options.max_distance = 2.0;
    ExpectBruteForce(a, b, options);
  }
}

TEST(DescriptorMatching, LargestValuesDoNotOverflow) {
  TestDescriptors bright;
  bright.values.assign(3 * DescriptorView::kDim, 255);
  for (const InstructionSet set : InstructionSets()) {
    const auto [of_1, of_2] = FindTwoNearest(bright.View(), bright.View(), set);
    for (const auto& nearest : {of_1, of_2}) {
      for (const TwoNearest& two : nearest) {
        EXPECT_EQ(two.best_dot, 255 * 255 * 128);
        EXPECT_EQ(two.second_dot, 255 * 255 * 128);
        EXPECT_EQ(two.best_idx, 0);  // the first of equal ones
      }
    }
  }
}

TEST(DescriptorMatching, RepeatedDescriptorsAreAmbiguous) {
  Random random(5);
  const TestDescriptors a = RandomDescriptors(20, &random);
  TestDescriptors b = a;
  const auto repeat = [&](size_t i) {
    b.values.insert(b.values.end(), a.View().Row(i), a.View().Row(i + 1));
  };
  repeat(4);
  const auto matches = MatchDescriptors(a.View(), b.View(), {});
  ASSERT_EQ(matches.size(), 19u);
  for (const Match& match : matches) EXPECT_NE(match.keypoint_idx1, 4u);
}

TEST(DescriptorMatching, UsesTheFirstDescriptorsOnly) {
  Random random(6);
  const TestDescriptors a = RandomDescriptors(30, &random);
  DescriptorMatchingOptions options;
  options.max_num_matches = 12;
  const auto matches = MatchDescriptors(a.View(), a.View(), options);
  ASSERT_EQ(matches.size(), 12u);
  EXPECT_EQ(matches.back().keypoint_idx2, 11u);
}

// Descriptors of any values, with many equal products.
TEST(DescriptorMatching, InstructionSetsFindTheSameTwoNearest) {
  Random random(11);
  for (const uint32_t size : {2u, 256u}) {
    TestDescriptors a, b;
    for (auto [descriptors, number] :
         {std::pair(&a, 130), std::pair(&b, 260)}) {
      for (size_t k = 0; k < number * DescriptorView::kDim; ++k) {
        descriptors->values.push_back(static_cast<uint8_t>(random.Index(size)));
      }
    }
    const auto expected =
        FindTwoNearest(a.View(), b.View(), InstructionSet::kPortable);
    for (const InstructionSet set : InstructionSets()) {
      const auto found = FindTwoNearest(a.View(), b.View(), set);
      EXPECT_EQ(found.of_1, expected.of_1);
      EXPECT_EQ(found.of_2, expected.of_2);
    }
  }
}

// Two ranges per row of tiles, one of them empty for some rows.
TEST(DescriptorMatching, ComparesSelectedTilesOnly) {
  Random random(12);
  const TestDescriptors a = RandomDescriptors(300, &random);
  const TestDescriptors b = PartlyMatching(a, 4200, 10.0, &random);
  TileSelection tiles(a.size(), b.size());
  const auto begin1 = [](size_t row) { return 90 * row; };
  const auto end1 = [](size_t row) { return 90 * row + 16 * (row % 3); };
  const auto begin2 = [](size_t row) { return 4000 - 32 * row; };
  for (size_t row = 0; row * kTileRows < a.size(); ++row) {
    tiles.Select(row, begin1(row), end1(row));
    tiles.Select(row, begin2(row), 4200);
  }
  TwoNearestOfPair expected;
  expected.of_1.resize(a.size());
  expected.of_2.resize(b.size());
  const auto enter = [](int32_t dot, size_t idx, TwoNearest* nearest) {
    if (dot > nearest->best_dot) {
      nearest->second_dot = nearest->best_dot;
      nearest->best_dot = dot;
      nearest->best_idx = static_cast<int32_t>(idx);
    } else {
      nearest->second_dot = std::max(nearest->second_dot, dot);
    }
  };
  for (size_t i = 0; i < a.size(); ++i) {
    const size_t row = i / kTileRows;
    for (size_t j = 0; j < b.size(); ++j) {
      // Tiles of columns that contain a selected descriptor.
      const size_t tile = j / kTileColumns * kTileColumns;
      const bool is_selected =
          (end1(row) > begin1(row) && tile + kTileColumns > begin1(row) &&
           tile < end1(row)) ||
          tile + kTileColumns > begin2(row);
      if (!is_selected) continue;
      int32_t dot = 0;
      for (size_t k = 0; k < DescriptorView::kDim; ++k) {
        dot += int32_t{a.View().Row(i)[k]} * b.View().Row(j)[k];
      }
      enter(dot, j, &expected.of_1[i]);
      enter(dot, i, &expected.of_2[j]);
    }
  }
  for (const InstructionSet set : InstructionSets()) {
    const auto found = FindTwoNearest(a.View(), b.View(), set, &tiles);
    EXPECT_EQ(found.of_1, expected.of_1);
    EXPECT_EQ(found.of_2, expected.of_2);
  }
}

TEST(DescriptorMatching, InstructionSetsAgreeOnSelectedTiles) {
  Random random(13);
  const TestDescriptors ancestors = RandomDescriptors(40, &random);
  TestDescriptors a, b;
  for (int i = 0; i < 400; ++i) {
    const double noise = random.Uniform(4.0, 24.0);
    a.AddNoisyCopy(ancestors.View().Row(i % ancestors.size()), noise, &random);
    b.AddNoisyCopy(a.View().Row(a.size() - 1), 0.2 * noise, &random);
  }
  TileSelection tiles(a.size(), b.size());
  for (size_t row = 0; row < a.size() / kTileRows; ++row) {
    tiles.Select(row, kTileRows * row,
                 std::min(kTileRows * row + 100, b.size()));
  }
  for (const double max_ratio : {0.8, 0.95}) {
    DescriptorMatchingOptions options;
    options.max_ratio = max_ratio;
    const auto expected = MatchDescriptors(a.View(), b.View(), options,
                                           InstructionSet::kPortable, &tiles);
    EXPECT_GE(expected.size(), 20u);
    for (const InstructionSet set : InstructionSets()) {
      EXPECT_EQ(MatchDescriptors(a.View(), b.View(), options, set, &tiles),
                expected);
    }
  }
}

}  // namespace
}  // namespace mgsfm

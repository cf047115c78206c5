// SPDX-License-Identifier: BSD-3-Clause
#include "rig_solver/preconditioner_pattern.h"

#include <gtest/gtest.h>

#include <cstdlib>
#include <vector>

namespace mgsfm {
namespace {

TEST(PreconditionerPatternTest, KeepsTheHeaviestOfEitherBlock) {
  // A star and one separate pair.
  const std::vector<WeightedPair> pairs = {
      {0, 1, 3}, {0, 2, 5}, {0, 3, 4}, {1, 2, 9}};
  const PreconditionerPattern strong(pairs, 5, 1);
  EXPECT_TRUE(strong.Contains(0, 2));   // of 0
  EXPECT_TRUE(strong.Contains(1, 2));   // of 1 and of 2
  EXPECT_TRUE(strong.Contains(3, 0));   // of 3
  EXPECT_FALSE(strong.Contains(0, 1));  // both have a heavier one
  EXPECT_FALSE(strong.Contains(2, 3));  // no pair at all
  EXPECT_TRUE(strong.Contains(4, 4));
}

TEST(PreconditionerPatternTest, TiesPreferCloseIndices) {
  std::vector<WeightedPair> pairs;
  for (int a = 0; a < 12; ++a) {
    for (int b = a + 1; b < 12; ++b) pairs.push_back({a, b, 7});
  }
  const PreconditionerPattern strong(pairs, 12, 4);
  for (int a = 2; a < 10; ++a) {
    for (int b = 2; b < 10; ++b) {
      EXPECT_EQ(strong.Contains(a, b), std::abs(a - b) <= 2) << a << " " << b;
    }
  }
}

TEST(PreconditionerPatternTest, InfiniteWeightsAreKept) {
  const std::vector<WeightedPair> pairs = {
      {0, 1, 8}, {0, 2, kInfiniteWeight}, {1, 2, 8}};
  const PreconditionerPattern strong(pairs, 3, 0);
  EXPECT_TRUE(strong.Contains(0, 2));
  EXPECT_FALSE(strong.Contains(0, 1));
  EXPECT_FALSE(strong.Contains(1, 2));
}

}  // namespace
}  // namespace mgsfm

// SPDX-License-Identifier: BSD-3-Clause
#include "base/random.h"

#include <gtest/gtest.h>

#include <array>
#include <cmath>

#include "mgsfm/base/error.h"

namespace mgsfm {
namespace {

constexpr int kNumSamples = 100000;

TEST(Random, SameSeedGivesTheSameNumbers) {
  Random a(7), b(7), other(8);
  int num_different = 0;
  for (int i = 0; i < 100; ++i) {
    const uint64_t bits = a.NextBits();
    EXPECT_EQ(bits, b.NextBits());
    num_different += bits != other.NextBits();
  }
  EXPECT_EQ(num_different, 100);
}

TEST(Random, StreamsOfOneSeedAreUncorrelated) {
  for (uint64_t stream = 0; stream < 4; ++stream) {
    Random a(5, stream), b(5, stream + 1), c(6, stream);
    double correlation_ab = 0.0, correlation_ac = 0.0;
    for (int i = 0; i < kNumSamples; ++i) {
      const double value = a.Normal();
      correlation_ab += value * b.Normal() / kNumSamples;
      correlation_ac += value * c.Normal() / kNumSamples;
    }
    // The tolerance is five standard deviations.
    const double bound = 5.0 / std::sqrt(kNumSamples);
    EXPECT_LT(std::abs(correlation_ab), bound);
    EXPECT_LT(std::abs(correlation_ac), bound);
  }
}

TEST(Random, UniformHasItsRangeAndMoments) {
  Random random(1);
  double sum = 0.0, sum_of_squares = 0.0;
  for (int i = 0; i < kNumSamples; ++i) {
    const double value = random.Uniform(-1.0, 3.0);
    ASSERT_GE(value, -1.0);
    ASSERT_LT(value, 3.0);
    sum += value;
    sum_of_squares += value * value;
  }
  const double mean = sum / kNumSamples;
  EXPECT_NEAR(mean, 1.0, 5.0 * 4.0 / std::sqrt(12.0 * kNumSamples));
  EXPECT_NEAR(sum_of_squares / kNumSamples - mean * mean, 16.0 / 12.0, 0.03);
}

TEST(Random, IndexIsUniform) {
  Random random(2);
  std::array<int, 7> counts = {};
  for (int i = 0; i < kNumSamples; ++i) ++counts.at(random.Index(7));
  const double expected = kNumSamples / 7.0;
  for (const int count : counts) {
    EXPECT_NEAR(count, expected, 5.0 * std::sqrt(expected));
  }
  EXPECT_EQ(random.Index(1), 0u);
  EXPECT_THROW(random.Index(0), ContractError);
}

TEST(Random, NormalHasItsMoments) {
  Random random(3);
  double sum = 0.0, sum_of_squares = 0.0, sum_of_fourths = 0.0;
  for (int i = 0; i < kNumSamples; ++i) {
    const double value = random.Normal();
    ASSERT_TRUE(std::isfinite(value));
    sum += value;
    sum_of_squares += value * value;
    sum_of_fourths += value * value * value * value;
  }
  const double bound = 5.0 / std::sqrt(kNumSamples);
  EXPECT_NEAR(sum / kNumSamples, 0.0, bound);
  EXPECT_NEAR(sum_of_squares / kNumSamples, 1.0, bound * std::sqrt(2.0));
  EXPECT_NEAR(sum_of_fourths / kNumSamples, 3.0, bound * std::sqrt(96.0));
}

}  // namespace
}  // namespace mgsfm

// SPDX-License-Identifier: BSD-3-Clause
#include "math/robust_scale.h"

#include <gtest/gtest.h>

#include <cmath>
#include <vector>

#include "base/random.h"

namespace mgsfm {
namespace {

// Integral of the unnormalized chi density r^(k-1) exp(-r^2/2) by Simpson's
// rule.
double IntegrateChiDensity(int dimension, double begin, double end) {
  constexpr int kNumIntervals = 20000;
  const double h = (end - begin) / kNumIntervals;
  double sum = 0.0;
  for (int i = 0; i <= kNumIntervals; ++i) {
    const double r = begin + i * h;
    const double weight =
        i == 0 || i == kNumIntervals ? 1.0 : (i % 2 == 1 ? 4.0 : 2.0);
    sum += weight * std::pow(r, dimension - 1) * std::exp(-0.5 * r * r);
  }
  return sum * h / 3.0;
}

template <int kDimension>
void ExpectHalfOfTheProbability() {
  const double median = MedianOfStandardNormalNorm<kDimension>();
  // Less than 1e-30 of the probability lies beyond 14 sigma.
  const double below = IntegrateChiDensity(kDimension, 0.0, median);
  const double above = IntegrateChiDensity(kDimension, median, 14.0);
  EXPECT_NEAR(below / (below + above), 0.5, 1e-12) << kDimension;
}

TEST(RobustScale, MediansHalveTheChiDistribution) {
  ExpectHalfOfTheProbability<1>();
  ExpectHalfOfTheProbability<2>();
  ExpectHalfOfTheProbability<3>();
}

TEST(RobustScale, MediansOfTheChiSquareDistribution) {
  for (int k = 1; k <= 41; ++k) {
    const double median = MedianOfChiSquare(k);
    const double half = 0.5 * IntegrateChiDensity(k, 0.0, 20.0);
    EXPECT_LT(IntegrateChiDensity(k, 0.0, std::sqrt(0.996 * median)), half);
    EXPECT_GT(IntegrateChiDensity(k, 0.0, std::sqrt(1.004 * median)), half);
  }
}

TEST(RobustScale, SigmaOfSamplesWithOutliers) {
  Random random(1);
  std::vector<double> norms1, norms2, norms3;
  for (int i = 0; i < 20000; ++i) {
    const double x = 2.0 * random.Normal();
    const double y = 2.0 * random.Normal();
    const double z = 2.0 * random.Normal();
    norms1.push_back(std::abs(x));
    norms2.push_back(std::hypot(x, y));
    norms3.push_back(std::hypot(x, y, z));
  }
  EXPECT_NEAR(RobustSigma<1>(norms1), 2.0, 0.05);
  EXPECT_NEAR(RobustSigma<2>(norms2), 2.0, 0.05);
  EXPECT_NEAR(RobustSigma<3>(norms3), 2.0, 0.05);
  for (size_t i = 0; i < norms3.size(); i += 100) norms3[i] = 1e6;
  EXPECT_NEAR(RobustSigma<3>(norms3), 2.0, 0.1);
}

TEST(AnnealedScale, DecaysGeometricallyToTheTarget) {
  AnnealedScale scale(8.0, 0.5);
  EXPECT_EQ(scale.Next(1.5), 8.0);
  EXPECT_EQ(scale.Next(1.5), 4.0);
  EXPECT_EQ(scale.Next(1.5), 2.0);
  EXPECT_FALSE(scale.IsAtTarget());
  EXPECT_EQ(scale.Next(1.5), 1.5);
  EXPECT_TRUE(scale.IsAtTarget());
}

TEST(AnnealedScale, StartsAboveALargeTargetAndFollowsIt) {
  AnnealedScale scale(1.0, 0.5);
  EXPECT_EQ(scale.Next(3.0), 6.0);
  EXPECT_EQ(scale.Next(4.0), 4.0);
  EXPECT_TRUE(scale.IsAtTarget());
  EXPECT_EQ(scale.Next(1.0), 2.0);
  EXPECT_FALSE(scale.IsAtTarget());
}

}  // namespace
}  // namespace mgsfm

// SPDX-License-Identifier: BSD-3-Clause
#include "math/robust_loss.h"

#include <gtest/gtest.h>

namespace mgsfm {
namespace {

class RobustLossTest : public testing::TestWithParam<RobustLossType> {};

TEST_P(RobustLossTest, DerivativesAgreeWithDifferences) {
  const RobustLoss loss{GetParam(), 0.7};
  for (const double s : {0.01, 0.3, 0.48, 0.5, 2.0, 40.0}) {
    const double h = 1e-5 * s;
    const LossValue value = loss.Evaluate(s);
    EXPECT_NEAR(value.d1, (loss.Cost(s + h) - loss.Cost(s - h)) / (2 * h),
                1e-8);
    EXPECT_NEAR(value.d2, (loss.Weight(s + h) - loss.Weight(s - h)) / (2 * h),
                1e-7);
  }
}

TEST_P(RobustLossTest, IsTheSquareNearZeroAndNeverMore) {
  const RobustLoss loss{GetParam(), 2.0};
  EXPECT_EQ(loss.Cost(0.0), 0.0);
  EXPECT_EQ(loss.Weight(0.0), 1.0);
  for (const double s : {1e-6, 0.1, 3.0, 5.0, 100.0}) {
    EXPECT_LE(loss.Cost(s), s * (1.0 + 1e-12));
    EXPECT_GT(loss.Weight(s), 0.0);
    EXPECT_LE(loss.Weight(s), 1.0);
  }
}

INSTANTIATE_TEST_SUITE_P(AllTypes, RobustLossTest,
                         testing::Values(RobustLossType::kTrivial,
                                         RobustLossType::kHuber,
                                         RobustLossType::kCauchy,
                                         RobustLossType::kGemanMcClure));

}  // namespace
}  // namespace mgsfm

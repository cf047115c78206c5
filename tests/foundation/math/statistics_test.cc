// SPDX-License-Identifier: BSD-3-Clause
#include "math/statistics.h"

#include <gtest/gtest.h>

#include <optional>

#include "mgsfm/base/error.h"

namespace mgsfm {
namespace {

TEST(Statistics, Quantiles) {
  EXPECT_EQ(Median({3.0, 1.0, 2.0}), 2.0);
  EXPECT_EQ(Quantile({3.0, 1.0, 2.0, 5.0, 4.0}, 0.0), 1.0);
  EXPECT_EQ(Quantile({3.0, 1.0, 2.0, 5.0, 4.0}, 1.0), 5.0);
  EXPECT_EQ(Quantile({7.0}, 0.3), 7.0);
  EXPECT_THROW(Median({}), ContractError);
  EXPECT_THROW(MedianOfCoordinates({}), ContractError);
}

TEST(Statistics, DifferencesNeedTwoValues) {
  EXPECT_EQ(MedianDifference({1.0, 2.0, 5.0, 9.0}), 3.0);
  EXPECT_EQ(MedianDifference({7.0}), std::nullopt);
  EXPECT_EQ(MedianDifference({}), std::nullopt);
}

TEST(Statistics, CoordinatesHaveTheirOwnMedians) {
  EXPECT_EQ(
      MedianOfCoordinates({{1.0, 9.0, 4.0}, {2.0, 7.0, 6.0}, {3.0, 8.0, 5.0}}),
      Eigen::Vector3d(2.0, 8.0, 5.0));
}

}  // namespace
}  // namespace mgsfm

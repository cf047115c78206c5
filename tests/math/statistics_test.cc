// SPDX-License-Identifier: BSD-3-Clause
#include "math/statistics.h"

#include <gtest/gtest.h>

#include "mgsfm/base/error.h"

namespace mgsfm {
namespace {

TEST(Statistics, Quantiles) {
  EXPECT_EQ(Median({3.0, 1.0, 2.0}), 2.0);
  EXPECT_EQ(Quantile({3.0, 1.0, 2.0, 5.0, 4.0}, 0.0), 1.0);
  EXPECT_EQ(Quantile({3.0, 1.0, 2.0, 5.0, 4.0}, 1.0), 5.0);
  EXPECT_EQ(Quantile({7.0}, 0.3), 7.0);
  EXPECT_THROW(Median({}), ContractError);
}

}  // namespace
}  // namespace mgsfm

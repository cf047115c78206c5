// SPDX-License-Identifier: BSD-3-Clause
#include "math/statistics.h"

#include <gtest/gtest.h>

#include <cmath>

#include "mgsfm/base/error.h"
#include "mgsfm/base/random.h"

namespace mgsfm {
namespace {

TEST(Statistics, Quantiles) {
  EXPECT_EQ(Median({3.0, 1.0, 2.0}), 2.0);
  EXPECT_EQ(Quantile({3.0, 1.0, 2.0, 5.0, 4.0}, 0.0), 1.0);
  EXPECT_EQ(Quantile({3.0, 1.0, 2.0, 5.0, 4.0}, 1.0), 5.0);
  EXPECT_EQ(Quantile({7.0}, 0.3), 7.0);
  EXPECT_THROW(Median({}), ContractError);
}

TEST(Statistics, RobustSigmaOfNormalVectors) {
  Random random(1);
  std::vector<double> norms;
  for (int i = 0; i < 20000; ++i) {
    norms.push_back(
        2.0 * std::hypot(random.Normal(), random.Normal(), random.Normal()));
  }
  EXPECT_NEAR(RobustSigmaOfNorms3(norms), 2.0, 0.05);
}

}  // namespace
}  // namespace mgsfm

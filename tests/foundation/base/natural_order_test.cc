// SPDX-License-Identifier: BSD-3-Clause
#include "base/natural_order.h"

#include <gtest/gtest.h>

#include <optional>
#include <string>
#include <utility>
#include <vector>

namespace mgsfm {
namespace {

TEST(NaturalOrder, DifferencesAreThoseOfASingleNumber) {
  EXPECT_EQ(NumberDifference("left/07.png", "left/10.png"), 3.0);
  EXPECT_EQ(NumberDifference("10", "7"), -3.0);
  EXPECT_EQ(NumberDifference("1_5_2", "1_9_2"), 4.0);
  EXPECT_EQ(NumberDifference("1403636579763555584", "1403636579813555456"),
            49999872.0);
  EXPECT_EQ(NumberDifference("20230501000000000003", "20230501000000000036"),
            33.0);
  for (const auto& [a, b] : std::vector<std::pair<std::string, std::string>>{
           {"", ""},
           {"a", "b"},
           {"7", "07"},     // one number
           {"1_5", "2_6"},  // two differences
           {"a1", "b2"},
           {"1", "2b"},
           {"1b", "2"}}) {
    EXPECT_EQ(NumberDifference(a, b), std::nullopt) << a << " " << b;
  }
}

}  // namespace
}  // namespace mgsfm

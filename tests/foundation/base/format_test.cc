// SPDX-License-Identifier: BSD-3-Clause
#include "base/format.h"

#include <gtest/gtest.h>

namespace mgsfm {
namespace {

TEST(FormattedTest, PrintsNumbersAndText) {
  EXPECT_EQ(Formatted("%d of %.1f %s %%", 3, 2.5, "px"), "3 of 2.5 px %");
  EXPECT_EQ(Formatted("%s", ""), "");
}

TEST(FormattedTest, TextMayHaveAnyLength) {
  const std::string name(5000, 'x');
  EXPECT_EQ(Formatted("'%s'", name.c_str()), "'" + name + "'");
}

}  // namespace
}  // namespace mgsfm

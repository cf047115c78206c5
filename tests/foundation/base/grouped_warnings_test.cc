// SPDX-License-Identifier: BSD-3-Clause
#include "base/grouped_warnings.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

namespace mgsfm {
namespace {

using testing::ElementsAre;

std::vector<std::string> Logged(const GroupedWarnings& warnings) {
  std::vector<std::string> lines;
  Context context;
  context.log = [&lines](LogLevel level, const std::string& message) {
    EXPECT_EQ(level, LogLevel::kWarning);
    lines.push_back(message);
  };
  warnings.Log(context);
  return lines;
}

TEST(GroupedWarnings, OneLinePerCauseWithAnExampleAndACount) {
  GroupedWarnings warnings;
  for (int i = 0; i < 5000; ++i) {
    warnings.Add("image 'cam0/" + std::to_string(i) + ".jpg' does not exist");
    if (i == 3) warnings.Add("image 'x.jpg' has 7 features");
  }
  EXPECT_THAT(Logged(warnings),
              ElementsAre("image 'cam0/0.jpg' does not exist (the first of "
                          "5000 such warnings)",
                          "image 'x.jpg' has 7 features"));
  EXPECT_THAT(Logged(GroupedWarnings()), ElementsAre());
}

TEST(GroupedWarnings, KindsDifferInWordsOnly) {
  EXPECT_EQ(KindOfMessage("image 'a' has 3.5 px"),
            KindOfMessage("image 'b c' has 12 px"));
  EXPECT_NE(KindOfMessage("image 'a' is black"),
            KindOfMessage("image 'a' is empty"));
  EXPECT_NE(KindOfMessage("it's a"), KindOfMessage("it's b"));
}

}  // namespace
}  // namespace mgsfm

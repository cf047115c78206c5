// SPDX-License-Identifier: BSD-3-Clause
#include "base/grouped_warnings.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "base/text_tools.h"

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

TEST(SplitFields, ReadsWhatQuotedFieldWrites) {
  for (const std::string text :
       {"a", "a,b", "say \"no\"", "\"", "", " a ", ",\",\"\","}) {
    EXPECT_THAT(SplitFields("1," + QuotedField(text) + ",2"),
                ElementsAre("1", text, "2"));
  }
  EXPECT_THAT(SplitFields("a,b\r"), ElementsAre("a", "b"));
  EXPECT_THAT(SplitFields(""), ElementsAre(""));
}

}  // namespace
}  // namespace mgsfm

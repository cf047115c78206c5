// SPDX-License-Identifier: BSD-3-Clause
#include "base/text_lines.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <string>

#include "base/text_tools.h"
#include "support/error_of.h"

namespace mgsfm {
namespace {

using testing::AllOf;
using testing::ElementsAre;
using testing::HasSubstr;

std::vector<std::string> LinesOf(const std::string& text) {
  TextLines lines = TextLines::Of(text, "a.txt");
  std::vector<std::string> all;
  while (lines.Next()) all.emplace_back(lines.line());
  return all;
}

TEST(TextLines, EndsOfLinesAndTheByteOrderMarkDoNotCount) {
  const std::vector<std::string> expected = {"a b", "", "c"};
  for (const std::string end : {"\n", "\r\n", "\r"}) {
    for (const std::string mark : {"", "\xef\xbb\xbf"}) {
      for (const std::string& last : {std::string(), end}) {
        const std::string text =
            mark + "  a b \t" + end + " " + end + "c" + last;
        EXPECT_EQ(LinesOf(text), expected) << text;
      }
    }
  }
  EXPECT_TRUE(LinesOf("").empty());
}

TEST(TextLines, AByteOrderMarkWithinTheTextIsRefused) {
  EXPECT_THAT(ErrorOf([] { LinesOf("a\r\nb\xef\xbb\xbf c"); }),
              AllOf(HasSubstr("a.txt, line 2"), HasSubstr("byte-order")));
}

TEST(TextLines, CommentsAreSkippedAndCounted) {
  TextLines lines = TextLines::Of("# one\n\n  # two\nx # y\n#z", "'a.txt'");
  ASSERT_TRUE(lines.NextContent());
  EXPECT_EQ(lines.line(), "x # y");
  EXPECT_EQ(lines.Place(), "'a.txt', line 4");
  EXPECT_EQ(ErrorOf([&] { lines.Throw("is bad"); }), "'a.txt', line 4: is bad");
  EXPECT_FALSE(lines.NextContent());
}

TEST(TextLines, OtherEncodingsAreRefused) {
  for (const std::string& text : {std::string("\xff\xfe"
                                              "a\0",
                                              4),
                                  std::string("\xfe\xff\0a", 4)}) {
    EXPECT_THAT(ErrorOf([&] { LinesOf(text); }), HasSubstr("UTF-16"));
  }
  EXPECT_THAT(ErrorOf([] { LinesOf(std::string("a\0b", 3)); }),
              HasSubstr("not a text file"));
}

TEST(TextLines, NamesMayHaveBlanks) {
  const auto split = SplitNamedWords(" a b  c.jpg\t1 2.5 ", 2);
  ASSERT_TRUE(split.has_value());
  EXPECT_EQ(split->name, "a b  c.jpg");
  EXPECT_THAT(split->words, ElementsAre("1", "2.5"));
  EXPECT_FALSE(SplitNamedWords("1 2", 2).has_value());
  EXPECT_FALSE(SplitNamedWords("", 1).has_value());
}

TEST(TextLines, FieldsMayBeEmpty) {
  EXPECT_THAT(SplitFields("1,, 2 ,", ','), ElementsAre("1", "", "2", ""));
  EXPECT_THAT(SplitFields("", ','), ElementsAre(""));
}

TEST(TextLines, FieldsOfCsvMayBeQuoted) {
  EXPECT_THAT(*SplitCsv(R"("a,""b""",1,)"), ElementsAre(R"(a,"b")", "1", ""));
  EXPECT_FALSE(SplitCsv(R"("a,1)").has_value());
  const std::string name = R"(a, "b" c)";
  EXPECT_THAT(*SplitCsv(QuoteCsv(name) + ",2"), ElementsAre(name, "2"));
}

TEST(TextLines, NumbersAreWholeWords) {
  EXPECT_THAT(*ParseNumbers(" 1e+003\t-2.5e-005 +7 "),
              ElementsAre(1000.0, -2.5e-5, 7.0));
  EXPECT_THAT(*ParseNumbers("1e-400 -1e-400"), ElementsAre(0.0, 0.0));
  for (const char* line : {"1 2x", "1,5", "0x1", "nan", "1e999", "1 inf"}) {
    EXPECT_FALSE(ParseNumbers(line).has_value()) << line;
  }
}

}  // namespace
}  // namespace mgsfm

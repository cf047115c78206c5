// SPDX-License-Identifier: BSD-3-Clause
#include "matching/match_list.h"

#include <gtest/gtest.h>

#include "support/error_of.h"

namespace mgsfm {
namespace {

const std::vector<std::string> kNames = {"a/1.png", "a/2.png", "b c/1.png",
                                         "b c/2.png"};

ImagePairList Pairs(const std::string& text) {
  return ReadPairList(TextLines::Of(text, "pairs.txt"), kNames);
}

std::vector<ListedMatches> Matches(const std::string& text) {
  return ReadMatchList(TextLines::Of(text, "matches.txt"), kNames);
}

TEST(PairList, IsSortedAndWithoutRepetition) {
  EXPECT_EQ(Pairs("# pairs\n"
                  "a/2.png a/1.png\r\n"
                  "\n"
                  "  a/1.png\tb c/2.png  \n"
                  "a/1.png a/2.png\n"
                  "b c/1.png b c/2.png"),
            (ImagePairList{{0, 1}, {0, 3}, {2, 3}}));
  EXPECT_TRUE(Pairs("").empty());
}

TEST(PairList, ErrorsNameTheLine) {
  EXPECT_EQ(ErrorOf([] { Pairs("a/1.png a/2.png\na/1.png c/9.png\n"); }),
            "pairs.txt, line 2: 'a/1.png c/9.png' does not name two images of "
            "the database; names are relative to the image folder");
  EXPECT_THROW(Pairs("a/1.png"), Error);
  EXPECT_THROW(Pairs("a/1.png a/1.png"), Error);
  EXPECT_THROW(ReadPairList(TextLines::Of("x x x", ""), {"x", "x x"}), Error);
}

TEST(MatchList, MatchesFollowTheOrderOfImages) {
  const auto lists = Matches(
      "b c/1.png a/1.png\n"
      "0 7\n"
      "5 3\n"
      "\n"
      "\n"
      "a/1.png a/2.png\n"
      "# a comment\n"
      "1  2\n"
      "\n"
      "a/2.png b c/2.png\n");
  ASSERT_EQ(lists.size(), 3u);
  EXPECT_EQ(lists[0].images, (ImageIdxPair{0, 1}));
  ASSERT_EQ(lists[0].matches.size(), 1u);
  EXPECT_EQ(lists[0].matches[0].keypoint_idx1, 1u);
  EXPECT_EQ(lists[0].matches[0].keypoint_idx2, 2u);
  EXPECT_EQ(lists[1].images, (ImageIdxPair{0, 2}));
  ASSERT_EQ(lists[1].matches.size(), 2u);
  EXPECT_EQ(lists[1].matches[0].keypoint_idx1, 7u);
  EXPECT_EQ(lists[1].matches[0].keypoint_idx2, 0u);
  EXPECT_TRUE(lists[2].matches.empty());
}

TEST(MatchList, ErrorsNameTheLine) {
  EXPECT_EQ(ErrorOf([] { Matches("a/1.png a/2.png\n0 1\n2 x\n"); }),
            "matches.txt, line 3: '2 x' is not a match, that is, two keypoint "
            "indices");
  for (const char* match : {"1", "1 2 3", "-1 2", "1.5 2", "99999999999 1"}) {
    EXPECT_THROW(Matches(std::string("a/1.png a/2.png\n") + match + "\n"),
                 Error)
        << match;
  }
  EXPECT_THROW(Matches("a/1.png a/2.png\n\na/2.png a/1.png\n"), Error);
}

}  // namespace
}  // namespace mgsfm

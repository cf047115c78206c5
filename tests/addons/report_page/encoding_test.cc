// SPDX-License-Identifier: BSD-3-Clause
#include "report_page/encoding.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

namespace mgsfm {
namespace {

using testing::Each;
using testing::HasSubstr;
using testing::Not;
using testing::SizeIs;
using Json = nlohmann::ordered_json;

// The test vectors of RFC 4648.
TEST(Base64, IsThatOfTheStandard) {
  EXPECT_EQ(ToBase64(""), "");
  EXPECT_EQ(ToBase64("f"), "Zg==");
  EXPECT_EQ(ToBase64("fo"), "Zm8=");
  EXPECT_EQ(ToBase64("foo"), "Zm9v");
  EXPECT_EQ(ToBase64("foobar"), "Zm9vYmFy");
  EXPECT_EQ(ToBase64(std::string(1, '\xff')), "/w==");
  for (size_t size = 0; size < 9; ++size) {
    EXPECT_THAT(ToBase64(std::string(size, 'a')), SizeIs(Base64Size(size)));
  }
}

TEST(EscapeHtml, LeavesNoMarkup) {
  EXPECT_EQ(EscapeHtml("<a b=\"c\">'&"), "&lt;a b=&quot;c&quot;&gt;&#39;&amp;");
  EXPECT_EQ(EscapeHtml("a\nb\x7f"), "a b ");
  EXPECT_EQ(EscapeHtml("\u05d0"), "\u05d0");
  EXPECT_EQ(EscapeHtml("a\xff"), "a\ufffd");
}

TEST(ToScriptJson, CannotEndAScript) {
  const Json json = {{"name", "</script><!-- \xff"}};
  const std::string text = ToScriptJson(json);
  EXPECT_THAT(text, Not(HasSubstr("<")));
  EXPECT_EQ(Json::parse(text)["name"], "</script><!-- \ufffd");
}

TEST(Shorten, KeepsBothEndsAndWholeCharacters) {
  EXPECT_EQ(Shorten("short", 10), "short");
  const std::string text = Shorten(std::string(100, 'a') + "z", 11);
  EXPECT_EQ(text, "aaaa\u2026aaaz");
  for (size_t size = 4; size < 30; ++size) {
    const std::string hebrew = Shorten(
        "\u05d0\u05d1\u05d2\u05d3\u05d4\u05d5"
        "\u05d6\u05d7\u05d8\u05d9\u05da\u05db",
        size);
    EXPECT_LE(hebrew.size(), std::max<size_t>(size, 24));
    EXPECT_EQ(ToValidUtf8(hebrew), hebrew);
  }
}

std::vector<std::string> DecodeNames(const Json& coded) {
  std::vector<std::string> names;
  std::string last;
  for (size_t i = 0; i < coded.size(); i += 2) {
    last = last.substr(0, coded[i].get<size_t>()) +
           coded[i + 1].get<std::string>();
    names.push_back(last);
  }
  return names;
}

TEST(FrontCode, KeepsNamesThatFit) {
  const std::vector<std::string> names = {
      "cam0/000.png", "cam0/001.png", "cam1/000.png", "", "\u05d0a", "\u05d0b"};
  EXPECT_EQ(DecodeNames(FrontCode(names, 10'000)), names);
}

TEST(FrontCode, ShortensNamesThatDoNotFit) {
  std::vector<std::string> names;
  for (int i = 0; i < 1000; ++i) {
    names.push_back(std::to_string(i * 7919 % 1000) + std::string(300, 'x'));
  }
  constexpr size_t kMaxBytes = 50'000;
  const Json coded = FrontCode(names, kMaxBytes);
  EXPECT_LE(ToScriptJson(coded).size(), kMaxBytes);
  EXPECT_THAT(DecodeNames(coded), SizeIs(names.size()));
}

TEST(ArrayWriter, AlignsArrays) {
  ArrayWriter arrays;
  arrays.Add("a", std::vector<uint8_t>{1, 2, 3, 4, 5});
  arrays.Add("b", std::vector<uint32_t>{7});
  arrays.Add("c", std::vector<float>{});
  EXPECT_EQ(arrays.directory().dump(),
            R"({"a":["u8",0,5],"b":["u32",8,1],"c":["f32",12,0]})");
  EXPECT_THAT(arrays.bytes(), SizeIs(12));
  EXPECT_EQ(arrays.bytes()[8], 7);
}

}  // namespace
}  // namespace mgsfm

// SPDX-License-Identifier: BSD-3-Clause
#include "base/text.h"

#include <gtest/gtest.h>

#include <cstdlib>
#include <locale>
#include <string>

#include "base/file_reading.h"
#include "mgsfm/base/error.h"
#include "support/temp_dir.h"

namespace mgsfm {
namespace {

std::string Encode(char32_t c) {
  const auto byte = [](char32_t value) { return static_cast<char>(value); };
  if (c < 0x80) return {byte(c)};
  if (c < 0x800) return {byte(0xc0 | c >> 6), byte(0x80 | (c & 63))};
  if (c < 0x10000) {
    return {byte(0xe0 | c >> 12), byte(0x80 | (c >> 6 & 63)),
            byte(0x80 | (c & 63))};
  }
  return {byte(0xf0 | c >> 18), byte(0x80 | (c >> 12 & 63)),
          byte(0x80 | (c >> 6 & 63)), byte(0x80 | (c & 63))};
}

// The definition of UTF-8 against its encoder, over all code points.
TEST(WhyUnusable, AcceptsTheCharactersOfUnicodeAndNothingElse) {
  for (char32_t c = 0; c < 0x111000; ++c) {
    const bool is_control = c < 0x20 || (c >= 0x7f && c < 0xa0);
    const bool is_surrogate = c >= 0xd800 && c < 0xe000;
    const bool is_usable = !is_control && !is_surrogate && c < 0x110000;
    ASSERT_EQ(!WhyUnusable("a" + Encode(c) + "b"), is_usable) << std::hex << c;
  }
}

TEST(WhyUnusable, RefusesWhatIsNoUtf8) {
  for (const char* text : {"\x80", "a\xff", "\xc3", "\xc3(", "\xe2\x82",
                           "\xc0\xaf", "\xe0\x80\xaf", "\xf0\x80\x80\xaf"}) {
    EXPECT_EQ(WhyUnusable(text), "is not valid UTF-8");
  }
  EXPECT_EQ(WhyUnusable(std::string(1, '\0')), "has a control character");
  EXPECT_FALSE(WhyUnusable(std::string(4096, 'x')));
  EXPECT_TRUE(WhyUnusable(std::string(4097, 'x')));
  EXPECT_FALSE(WhyUnusable(""));
}

TEST(Printable, IsOneLineOfUtf8) {
  EXPECT_EQ(Printable("a\n\x1b[1mb\xff\xc3\xa9"), "a  [1mb?\xc3\xa9");
  for (int c = 0; c < 256; ++c) {
    EXPECT_FALSE(WhyUnusable(Printable(std::string(1, static_cast<char>(c)))));
  }
}

TEST(Printable, KeepsBothEndsOfALongText) {
  const std::string path(4096, 'p');
  EXPECT_EQ(Printable(path + path), path + path);
  EXPECT_EQ(Printable(path + std::string(10'000'000, 'x') + path),
            path + " ... " + path);
  // The cut goes through a character.
  const std::string umlauts = "a" + std::string(2 * path.size(), '\xc3');
  EXPECT_FALSE(WhyUnusable(Printable(umlauts).substr(0, 4000)));
}

TEST(ParseDouble, TakesWholeFiniteNumbersOnly) {
  EXPECT_EQ(ParseDouble("-1.5e3"), -1500.0);
  EXPECT_EQ(ParseDouble("+2"), 2.0);
  for (const char* text :
       {"", "+", "+-1", "1,5", "1.5x", " 1", "nan", "inf", "1e999"}) {
    EXPECT_FALSE(ParseDouble(text)) << text;
  }
}

struct CommaPunctuation : std::numpunct<char> {
  char do_decimal_point() const override { return ','; }
  char do_thousands_sep() const override { return '.'; }
  std::string do_grouping() const override { return "\3"; }
};

TEST(Doubles, IgnoreTheLocale) {
  const std::locale before =
      std::locale::global(std::locale(std::locale(), new CommaPunctuation));
  EXPECT_EQ(ParseDouble("1234.5"), 1234.5);
  EXPECT_EQ(FormatDouble(1234.5, std::chars_format::fixed, 2), "1234.50");
  EXPECT_EQ(FormatDouble(0.1, std::chars_format::general, 17),
            "0.10000000000000001");
  std::locale::global(before);
}

// A database may be larger than the memory.
TEST(ReadFile, ReadsTheBeginningOfAHugeFile) {
  const TempDir dir;
  const auto path = dir.path() / "file";
  std::ofstream(path) << "begin";
  std::filesystem::resize_file(path, uintmax_t{1} << 42);  // has no blocks
  EXPECT_EQ(ReadFile(path, "", 5), "begin");
}

TEST(ReadFile, ReadsFilesOfAnySize) {
  const TempDir dir;
  for (const size_t size : {0u, 1u, 65536u, 1000003u}) {
    const std::string content(size, 'x');
    WriteTextFile(dir.path() / "file", content);
    EXPECT_TRUE(ReadFile(dir.path() / "file") == content);
    EXPECT_EQ(ReadFile(dir.path() / "file", "", 100).size(),
              std::min<size_t>(100, size));
  }
  EXPECT_FALSE(ReadFile("/proc/self/status").empty());  // its size is 0
}

std::string ReadError(const std::string& path) {
  try {
    ReadFile(path);
  } catch (const Error& error) {
    return error.what();
  }
  return "no error";
}

TEST(ReadFile, NamesFileReasonAndRemedy) {
  EXPECT_EQ(ReadError("/none"),
            "'/none' cannot be read (No such file or directory); check the "
            "path");
  EXPECT_EQ(ReadError("/"), "'/' cannot be read (Is a directory)");
  // Address 0 of the process, whose pages cannot be read.
  EXPECT_EQ(ReadError("/proc/self/mem"),
            "'/proc/self/mem' cannot be read (Input/output error); check its "
            "disk");
}

}  // namespace
}  // namespace mgsfm

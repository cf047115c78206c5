// SPDX-License-Identifier: BSD-3-Clause
// Parts of the reader of recordings that no file of tests/formats reaches.
#include <bzlib.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <string>

#include "mgsfm/base/error.h"
#include "recordings/decompression.h"
#include "support/error_of.h"

namespace mgsfm {
namespace {

std::string Bz2(std::string text) {
  std::string packed(text.size() + 1000, '\0');
  auto size = static_cast<unsigned>(packed.size());
  BZ2_bzBuffToBuffCompress(packed.data(), &size, text.data(),
                           static_cast<unsigned>(text.size()), 9, 0, 0);
  packed.resize(size);
  return packed;
}

// The check value of the algorithm's definition (CRC-32/ISO-HDLC).
TEST(DecompressionTest, ChecksumOfZlib) {
  EXPECT_EQ(Crc32("123456789"), 0xcbf43926u);
  EXPECT_EQ(Crc32(""), 0u);
}

TEST(DecompressionTest, MoreBytesThanClaimedAreDamage) {
  const std::string zeros(10'000'000, '\0');
  const std::string packed = Bz2(zeros);
  ASSERT_LT(packed.size(), 1000u);
  const DecompressedBytes whole = Decompress("bz2", packed, zeros.size());
  EXPECT_TRUE(whole.is_complete);
  EXPECT_EQ(whole.bytes, zeros);
  const DecompressedBytes fewer = Decompress("bz2", packed, 70'000);
  EXPECT_FALSE(fewer.is_complete);
  EXPECT_EQ(fewer.bytes.size(), 70'000u);
}

// A claim alone takes no memory.
TEST(DecompressionTest, FewerBytesThanClaimed) {
  const DecompressedBytes bytes = Decompress("bz2", Bz2("abc"), ~uint64_t{0});
  EXPECT_TRUE(bytes.is_complete);
  EXPECT_EQ(bytes.bytes, "abc");
  EXPECT_LT(bytes.bytes.capacity(), size_t{1} << 20);
}

TEST(DecompressionTest, DataThatEndEarlyGiveWhatIsThere) {
  for (const char* codec : {"bz2", "lz4", "zstd"}) {
    const DecompressedBytes bytes = Decompress(codec, "", 100);
    EXPECT_FALSE(bytes.is_complete) << codec;
    EXPECT_EQ(bytes.bytes, "") << codec;
  }
}

TEST(DecompressionTest, UnknownNamesAreRefused) {
  EXPECT_THAT(ErrorOf([] { CheckCompression("brotli", "'a.bag'"); }),
              testing::AllOf(testing::HasSubstr("a.bag"),
                             testing::HasSubstr("brotli")));
}

}  // namespace
}  // namespace mgsfm

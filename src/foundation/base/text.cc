// SPDX-License-Identifier: BSD-3-Clause
#include "base/text.h"

#include <algorithm>
#include <climits>
#include <cmath>
#include <cstdint>
#include <system_error>

#include "mgsfm/base/error.h"

namespace mgsfm {
namespace {

// The longest path that the system accepts.
constexpr size_t kMaxBytes = PATH_MAX;

// The size in bytes of the first character of the text; 0 if it is not valid
// UTF-8 (RFC 3629, section 4).
size_t CharacterSize(std::string_view text) {
  const auto byte = [&](size_t i) { return static_cast<uint8_t>(text[i]); };
  const uint8_t first = byte(0);
  if (first < 0x80) return 1;
  const size_t size = first >= 0xf0 ? 4 : first >= 0xe0 ? 3 : 2;
  if (first < 0xc2 || first > 0xf4 || text.size() < size) return 0;
  for (size_t i = 1; i < size; ++i) {
    if ((byte(i) & 0xc0) != 0x80) return 0;
  }
  const bool is_overlong =
      (first == 0xe0 && byte(1) < 0xa0) || (first == 0xf0 && byte(1) < 0x90);
  const bool is_surrogate = first == 0xed && byte(1) > 0x9f;
  const bool is_too_large = first == 0xf4 && byte(1) > 0x8f;
  return is_overlong || is_surrogate || is_too_large ? 0 : size;
}

// U+0000 to U+001F and U+007F to U+009F; `character` is valid UTF-8.
bool IsControl(std::string_view character) {
  const auto first = static_cast<uint8_t>(character[0]);
  if (character.size() == 1) return first < 0x20 || first == 0x7f;
  return first == 0xc2 && static_cast<uint8_t>(character[1]) < 0xa0;
}

}  // namespace

std::optional<std::string> WhyUnusable(std::string_view text) {
  if (text.size() > kMaxBytes) {
    return "is longer than " + std::to_string(kMaxBytes) + " bytes";
  }
  while (!text.empty()) {
    const size_t size = CharacterSize(text);
    if (size == 0) return "is not valid UTF-8";
    if (IsControl(text.substr(0, size))) return "has a control character";
    text.remove_prefix(size);
  }
  return std::nullopt;
}

std::string Printable(std::string_view text) {
  if (text.size() > 2 * kMaxBytes) {
    return Printable(text.substr(0, kMaxBytes)) + " ... " +
           Printable(text.substr(text.size() - kMaxBytes));
  }
  std::string line;
  while (!text.empty()) {
    const size_t size = CharacterSize(text);
    const std::string_view character =
        text.substr(0, std::max<size_t>(1, size));
    if (size == 0) {
      line += '?';
    } else if (IsControl(character)) {
      line += ' ';
    } else {
      line += character;
    }
    text.remove_prefix(character.size());
  }
  return line;
}

std::optional<double> ParseDouble(std::string_view word) {
  if (word.size() > 1 && word[0] == '+' && word[1] != '-') {
    word.remove_prefix(1);
  }
  double value = 0.0;
  const char* end = word.data() + word.size();
  auto [parsed_end, error] = std::from_chars(word.data(), end, value);
  if (error == std::errc::result_out_of_range) {
    // A number such as 1e-320 counts as zero.
    long double wide = 0.0L;
    const std::from_chars_result again =
        std::from_chars(word.data(), end, wide);
    parsed_end = again.ptr;
    error = again.ec;
    value = static_cast<double>(wide);
  }
  if (error != std::errc() || parsed_end != end || !std::isfinite(value)) {
    return std::nullopt;
  }
  return value;
}

std::string FormatDouble(double value, std::chars_format format,
                         int precision) {
  char buffer[512];  // 1e308 has 309 digits before the point
  const auto [end, error] =
      std::to_chars(buffer, buffer + sizeof(buffer), value, format, precision);
  MGSFM_CHECK(error == std::errc());
  return std::string(buffer, end);
}

}  // namespace mgsfm

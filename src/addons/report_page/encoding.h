// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <cstring>
#include <nlohmann/json.hpp>
#include <string>
#include <type_traits>
#include <vector>

namespace mgsfm {

// Whether a byte continues a character of UTF-8.
bool IsContinuation(char c);

std::string ToBase64(const std::string& bytes);

// Characters that base64 needs for so many bytes.
constexpr size_t Base64Size(size_t num_bytes) {
  return (num_bytes + 2) / 3 * 4;
}

// Replaces each byte that is not part of valid UTF-8.
std::string ToValidUtf8(const std::string& text);

// Text of the page with markup escaped. Bidirectional text and control
// characters do not affect their surroundings where the result stands in <bdi>.
std::string EscapeHtml(const std::string& text);

// JSON that may stand in a <script> element: it contains no '<'.
std::string ToScriptJson(const nlohmann::ordered_json& json);

// Valid UTF-8 of at most `max_bytes`, with the middle elided.
std::string Shorten(const std::string& text, size_t max_bytes);

// [shared, suffix, shared, suffix, ...]: each name is the first `shared`
// characters of the one before and the suffix. Names are shortened if all of
// them would need more than `max_bytes`.
nlohmann::ordered_json FrontCode(const std::vector<std::string>& names,
                                 size_t max_bytes);

// Typed arrays in one string of bytes, and their directory:
// {"name": [type, offset in bytes, number of values]}, little-endian.
class ArrayWriter {
 public:
  // T is float, int16_t, uint8_t or uint32_t.
  template <class T>
  void Add(const std::string& name, const std::vector<T>& values) {
    const char kind = std::is_floating_point_v<T> ? 'f'
                      : std::is_signed_v<T>       ? 'i'
                                                  : 'u';
    bytes_.resize((bytes_.size() + 3) / 4 * 4);
    directory_[name] = {kind + std::to_string(8 * sizeof(T)), bytes_.size(),
                        values.size()};
    if (values.empty()) return;
    const size_t offset = bytes_.size();
    bytes_.resize(offset + values.size() * sizeof(T));
    std::memcpy(bytes_.data() + offset, values.data(),
                values.size() * sizeof(T));
  }

  const std::string& bytes() const { return bytes_; }
  const nlohmann::ordered_json& directory() const { return directory_; }

 private:
  std::string bytes_;
  nlohmann::ordered_json directory_ = nlohmann::ordered_json::object();
};

}  // namespace mgsfm

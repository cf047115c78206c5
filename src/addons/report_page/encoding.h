// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <cstdint>
#include <cstring>
#include <nlohmann/json.hpp>
#include <string>
#include <string_view>
#include <vector>

namespace mgsfm {

constexpr std::string_view kBase64Digits =
    "ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz0123456789+/";

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
  void Add(const std::string& name, const std::vector<float>& values) {
    AddBytes(name, "f32", values);
  }
  void Add(const std::string& name, const std::vector<int16_t>& values) {
    AddBytes(name, "i16", values);
  }
  void Add(const std::string& name, const std::vector<uint8_t>& values) {
    AddBytes(name, "u8", values);
  }
  void Add(const std::string& name, const std::vector<uint32_t>& values) {
    AddBytes(name, "u32", values);
  }

  const std::string& bytes() const { return bytes_; }
  const nlohmann::ordered_json& directory() const { return directory_; }

 private:
  template <class T>
  void AddBytes(const std::string& name, const char* type,
                const std::vector<T>& values) {
    bytes_.resize((bytes_.size() + 3) / 4 * 4);
    directory_[name] = {type, bytes_.size(), values.size()};
    if (values.empty()) return;
    const size_t offset = bytes_.size();
    bytes_.resize(offset + values.size() * sizeof(T));
    std::memcpy(bytes_.data() + offset, values.data(),
                values.size() * sizeof(T));
  }

  std::string bytes_;
  nlohmann::ordered_json directory_ = nlohmann::ordered_json::object();
};

}  // namespace mgsfm

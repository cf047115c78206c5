// SPDX-License-Identifier: BSD-3-Clause
#include "report_page/encoding.h"

#include <algorithm>

#include "base/text_tools.h"

namespace mgsfm {
namespace {

using Json = nlohmann::ordered_json;

// Characters that the strings have in common at their start, as far as these
// are ASCII: JavaScript counts others differently.
size_t SharedPrefix(const std::string& a, const std::string& b) {
  size_t length = 0;
  while (length < std::min(a.size(), b.size()) && a[length] == b[length] &&
         static_cast<unsigned char>(a[length]) < 0x80) {
    ++length;
  }
  return length;
}

}  // namespace

bool IsContinuation(char c) {
  return (static_cast<unsigned char>(c) & 0xC0) == 0x80;
}

std::string ToBase64(const std::string& bytes) {
  constexpr char kDigits[] =
      "ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz0123456789+/";
  std::string text;
  text.reserve(Base64Size(bytes.size()));
  for (size_t i = 0; i < bytes.size(); i += 3) {
    const size_t num_bytes = std::min<size_t>(3, bytes.size() - i);
    uint32_t group = 0;
    for (size_t k = 0; k < 3; ++k) {
      group <<= 8;
      if (k < num_bytes) group |= static_cast<unsigned char>(bytes[i + k]);
    }
    for (size_t k = 0; k < 4; ++k) {
      text += k <= num_bytes ? kDigits[(group >> (18 - 6 * k)) & 63] : '=';
    }
  }
  return text;
}

std::string ToValidUtf8(const std::string& text) {
  const std::string quoted =
      Json(text).dump(-1, ' ', false, Json::error_handler_t::replace);
  return Json::parse(quoted).get<std::string>();
}

std::string EscapeHtml(const std::string& text) {
  std::string printable = ToValidUtf8(text);
  for (char& c : printable) {
    if (static_cast<unsigned char>(c) < 0x20 || c == 0x7F) c = ' ';
  }
  return EscapeMarkup(printable);
}

std::string ToScriptJson(const Json& json) {
  std::string text;
  for (const char c :
       json.dump(-1, ' ', false, Json::error_handler_t::replace)) {
    if (c == '<') {
      text += "\\u003c";
    } else {
      text += c;
    }
  }
  return text;
}

std::string Shorten(const std::string& text, size_t max_bytes) {
  std::string valid = ToValidUtf8(text);
  if (valid.size() <= max_bytes) return valid;
  static const std::string kEllipsis = "\u2026";
  const size_t num_kept =
      max_bytes > kEllipsis.size() ? max_bytes - kEllipsis.size() : 0;
  size_t head = num_kept / 2, tail = valid.size() - (num_kept - head);
  while (head > 0 && IsContinuation(valid[head])) --head;
  while (tail < valid.size() && IsContinuation(valid[tail])) ++tail;
  return valid.substr(0, head) + kEllipsis + valid.substr(tail);
}

Json FrontCode(const std::vector<std::string>& names, size_t max_bytes) {
  const auto encode = [&](size_t max_length) {
    Json json = Json::array();
    std::string last;
    for (const std::string& name : names) {
      std::string text = Shorten(name, max_length);
      const size_t shared = SharedPrefix(last, text);
      json.push_back(shared);
      json.push_back(text.substr(shared));
      last = std::move(text);
    }
    return json;
  };
  // Bytes of a name. Few names are longer; shorter ones do not tell images
  // apart.
  constexpr size_t kMaxLength = 400, kMinLength = 8;
  Json json = encode(kMaxLength);
  for (size_t length = kMaxLength / 2;
       length >= kMinLength && ToScriptJson(json).size() > max_bytes;
       length /= 2) {
    json = encode(length);
  }
  return json;
}

}  // namespace mgsfm

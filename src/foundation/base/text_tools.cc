// SPDX-License-Identifier: BSD-3-Clause
#include "base/text_tools.h"

#include <cctype>

#include "base/text_streams.h"

namespace mgsfm {

std::string ToLower(std::string text) {
  for (char& c : text) {
    c = static_cast<char>(std::tolower(static_cast<unsigned char>(c)));
  }
  return text;
}

std::string FolderOfName(const std::string& image_name) {
  const size_t slash = image_name.rfind('/');
  return slash == std::string::npos ? "" : image_name.substr(0, slash);
}

std::string StemOfName(const std::string& image_name) {
  const std::string file = image_name.substr(image_name.rfind('/') + 1);
  return file.substr(0, file.rfind('.'));
}

std::string EscapeMarkup(std::string_view text) {
  constexpr std::string_view kSpecial = "&<>\"'";
  constexpr const char* kEntities[] = {"&amp;", "&lt;", "&gt;", "&quot;",
                                       "&#39;"};
  std::string escaped;
  for (const char c : text) {
    const size_t i = kSpecial.find(c);
    escaped += i == std::string_view::npos ? std::string(1, c) : kEntities[i];
  }
  return escaped;
}

std::string QuoteCsv(std::string_view field) {
  std::string quoted = "\"";
  for (const char c : field) quoted += c == '"' ? "\"\"" : std::string(1, c);
  return quoted + '"';
}

std::string SizeText(int64_t width, int64_t height) {
  return std::to_string(width) + " x " + std::to_string(height);
}

std::vector<std::string> SplitList(const std::string& list) {
  std::vector<std::string> items;
  TextInput stream(list);
  for (std::string item; std::getline(stream, item, ',');) {
    if (!item.empty()) items.push_back(item);
  }
  return items;
}

}  // namespace mgsfm

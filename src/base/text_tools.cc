// SPDX-License-Identifier: BSD-3-Clause
#include "base/text_tools.h"

#include "base/text_streams.h"

namespace mgsfm {

std::string EscapeMarkup(std::string_view text) {
  std::string escaped;
  for (const char c : text) {
    switch (c) {
      case '&':
        escaped += "&amp;";
        break;
      case '<':
        escaped += "&lt;";
        break;
      case '>':
        escaped += "&gt;";
        break;
      case '"':
        escaped += "&quot;";
        break;
      case '\'':
        escaped += "&#39;";
        break;
      default:
        escaped += c;
    }
  }
  return escaped;
}

std::string QuotedField(std::string_view text) {
  std::string quoted = "\"";
  for (const char c : text) quoted += c == '"' ? "\"\"" : std::string(1, c);
  return quoted + "\"";
}

std::vector<std::string> SplitFields(std::string_view line) {
  std::vector<std::string> fields(1);
  bool is_quoted = false;
  for (size_t i = 0; i < line.size(); ++i) {
    const bool is_twice = is_quoted && line.substr(i, 2) == "\"\"";
    if (is_twice) {
      fields.back() += line[++i];
    } else if (line[i] == '"' && (is_quoted || fields.back().empty())) {
      is_quoted = !is_quoted;
    } else if (line[i] == ',' && !is_quoted) {
      fields.emplace_back();
    } else if (line[i] != '\r' || i + 1 < line.size()) {
      fields.back() += line[i];
    }
  }
  return fields;
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

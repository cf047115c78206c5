// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <cstdint>
#include <string>
#include <string_view>
#include <vector>

namespace mgsfm {

// Changes ASCII letters only.
std::string ToLower(std::string text);

// "a/b" and "c" of "a/b/c.jpg"; "" is the folder of a name in none.
std::string FolderOfName(const std::string& image_name);
std::string StemOfName(const std::string& image_name);

// The text for HTML, XML or SVG, with entities for & < > " and '.
std::string EscapeMarkup(std::string_view text);

// A field of CSV (RFC 4180) in quotes.
std::string QuoteCsv(std::string_view field);

// "640 x 480", the size of an image or table.
std::string SizeText(int64_t width, int64_t height);

// The items in one text, with the separator after each but empty ones at the
// start.
template <class Items>
std::string Joined(const Items& items, const char* separator) {
  std::string joined;
  for (const std::string& item : items) {
    joined += (joined.empty() ? "" : separator) + item;
  }
  return joined;
}

// The items of a list separated by commas, without empty ones.
std::vector<std::string> SplitList(const std::string& list);

}  // namespace mgsfm

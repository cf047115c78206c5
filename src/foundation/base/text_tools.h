// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <cstdint>
#include <string>
#include <string_view>
#include <vector>

namespace mgsfm {

// The text for HTML, XML or SVG, with entities for & < > " and '.
std::string EscapeMarkup(std::string_view text);

// A field of CSV (RFC 4180) in quotes.
std::string QuoteCsv(std::string_view field);

// "a/b" of "a/b/c.jpg"; "" for a name in no folder.
std::string FolderOf(const std::string& name);

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

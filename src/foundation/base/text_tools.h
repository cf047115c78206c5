// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <string>
#include <string_view>
#include <vector>

namespace mgsfm {

// Changes ASCII letters only.
std::string ToLower(std::string text);

// "a/b" and "c" of "a/b/c.jpg".
std::string FolderOfName(const std::string& image_name);
std::string StemOfName(const std::string& image_name);

// The text for HTML, XML or SVG, with entities for & < > " and '.
std::string EscapeMarkup(std::string_view text);

// A field of CSV (RFC 4180) in quotes.
std::string QuoteCsv(std::string_view field);

// The items of a list separated by commas, without empty ones.
std::vector<std::string> SplitList(const std::string& list);

}  // namespace mgsfm

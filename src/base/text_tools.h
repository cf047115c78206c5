// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <string>
#include <string_view>
#include <vector>

namespace mgsfm {

// The text for HTML, XML or SVG, with entities for & < > " and '.
std::string EscapeMarkup(std::string_view text);

// A field of a line of comma-separated values, in quotes.
std::string QuotedField(std::string_view text);

// The fields of such a line, without their quotes. A quote that does not end
// takes the rest of the line.
std::vector<std::string> SplitFields(std::string_view line);

// The items of a list separated by commas, without empty ones.
std::vector<std::string> SplitList(const std::string& list);

}  // namespace mgsfm

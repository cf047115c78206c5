// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <charconv>
#include <optional>
#include <string>
#include <string_view>

namespace mgsfm {

// The reason why a name, path or pattern from outside cannot be used, as in
// "is not valid UTF-8"; nullopt if it can. It must be UTF-8 without control
// characters, so that every file format and message can hold it, and not longer
// than the longest path of the system (4096 bytes).
std::optional<std::string> WhyUnusable(std::string_view text);

// One line of UTF-8 for messages: blanks instead of control characters, '?'
// instead of bytes that are not UTF-8. Of more than twice the longest path, for
// instance a line of a file that is quoted, only both ends are kept.
std::string Printable(std::string_view text);

// The finite number that a word consists of. Ignores the locale of the process,
// in which a comma may be the decimal point.
std::optional<double> ParseDouble(std::string_view word);

// Likewise; `precision` as for printf's %.*f (fixed) and %.*g (general).
std::string FormatDouble(double value, std::chars_format format, int precision);

}  // namespace mgsfm

// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <charconv>
#include <optional>
#include <string>
#include <string_view>

namespace mgsfm {

// The reason why a user-provided name, path or pattern is unusable, as in "is
// not valid UTF-8"; nullopt if it is usable. It must be UTF-8 without control
// characters, so that every file format and message can hold it, and not longer
// than the maximum path length (4096 bytes).
std::optional<std::string> WhyUnusable(std::string_view text);

// One line of UTF-8 for messages: blanks instead of control characters, '?'
// instead of bytes that are not UTF-8. Text longer than two paths of maximum
// length, such as a quoted line of a file, is shortened in the middle.
std::string Printable(std::string_view text);

// The value of a word that is a finite number. Ignores the locale, in which a
// comma may be the decimal point.
std::optional<double> ParseDouble(std::string_view word);

// Formats a number without the locale; `precision` as for printf's %.*f (fixed)
// and %.*g (general).
std::string FormatDouble(double value, std::chars_format format, int precision);

}  // namespace mgsfm

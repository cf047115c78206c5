// SPDX-License-Identifier: BSD-3-Clause
#include "exchange/import_text.h"

#include <algorithm>
#include <charconv>
#include <limits>
#include <optional>

#include "base/text.h"
#include "base/text_lines.h"
#include "mgsfm/base/error.h"

namespace mgsfm {
namespace {

constexpr std::string_view kBlanks = " \t\n\v\f";
constexpr size_t kMaxQuoted = 40;  // half of a line of a terminal

}  // namespace

ImportText::ImportText(const std::filesystem::path& path)
    : path_(path), text_(ReadText(path)) {}

void ImportText::Throw(const std::string& problem) const {
  throw Error("'" + path_.string() + "', line " + std::to_string(line_) + ": " +
              problem);
}

void ImportText::ThrowUnexpected(const char* expected,
                                 std::string_view found) const {
  Throw(std::string("expected ") + expected + ", but " +
        (found.empty() ? "the file ends; it is truncated, export it again"
                       : "found '" + Printable(found.substr(0, kMaxQuoted)) +
                             "'; correct the line, or export the file again"));
}

std::string_view ImportText::Word(const char* expected) {
  const std::string_view text = text_;
  const size_t first =
      std::min(text.find_first_not_of(kBlanks, position_), text.size());
  line_ += static_cast<int>(
      std::count(text.begin() + static_cast<std::ptrdiff_t>(position_),
                 text.begin() + static_cast<std::ptrdiff_t>(first), '\n'));
  const size_t end = std::min(text.find_first_of(kBlanks, first), text.size());
  position_ = end;
  if (first == end) ThrowUnexpected(expected, {});
  return text.substr(first, end - first);
}

double ImportText::Number(const char* expected) {
  const std::string_view word = Word(expected);
  const std::optional<double> number = ParseDouble(word);
  if (!number) ThrowUnexpected(expected, word);
  return *number;
}

uint64_t ImportText::Count(const char* expected) {
  const std::string_view word = Word(expected);
  uint64_t count = 0;
  const auto [end, error] =
      std::from_chars(word.data(), word.data() + word.size(), count);
  const bool is_count =
      error == std::errc() && end == word.data() + word.size();
  if (!is_count) ThrowUnexpected(expected, word);
  return count;
}

uint8_t ImportText::Color(const char* expected) {
  const uint64_t value = Count(expected);
  if (value > std::numeric_limits<uint8_t>::max()) {
    ThrowUnexpected(expected, std::to_string(value));
  }
  return static_cast<uint8_t>(value);
}

std::string_view ImportText::RestOfLine() {
  const std::string_view text = text_;
  const size_t end = std::min(text.find('\n', position_), text.size());
  const std::string_view rest = text.substr(position_, end - position_);
  position_ = end;
  return TrimBlanks(rest);
}

std::string_view ImportText::NextLine() {
  while (position_ < text_.size()) {
    if (text_[position_] == '\n') {
      ++position_;
      ++line_;
    }
    const std::string_view line = RestOfLine();
    if (!line.empty()) return line;
  }
  return {};
}

}  // namespace mgsfm

// SPDX-License-Identifier: BSD-3-Clause
#include "base/text_lines.h"

#include <algorithm>
#include <utility>

#include "base/file_reading.h"
#include "base/text.h"
#include "mgsfm/base/error.h"

namespace mgsfm {
namespace {

constexpr std::string_view kBlanks = " \t\r\v\f";
constexpr std::string_view kByteOrderMark = "\xef\xbb\xbf";

std::string NameOf(const std::filesystem::path& path, const std::string& what) {
  return what.empty() ? "'" + path.string() + "'" : what;
}

}  // namespace

std::string NormalizeText(std::string text, const std::string& what) {
  const std::string_view start = std::string_view(text).substr(0, 2);
  const bool is_utf16 = start == "\xff\xfe" || start == "\xfe\xff";
  if (is_utf16 || text.find('\0') != std::string::npos) {
    throw Error(what + (is_utf16 ? " is text in UTF-16; save it as UTF-8"
                                 : " is not a text file; check the path"));
  }
  if (text.compare(0, kByteOrderMark.size(), kByteOrderMark) == 0) {
    text.erase(0, kByteOrderMark.size());
  }
  // Concatenated files have more byte-order marks, invisible parts of names.
  const size_t mark = text.find(kByteOrderMark);
  if (mark != std::string::npos) {
    const auto line = std::count(text.data(), text.data() + mark, '\n') + 1;
    throw Error(what + ", line " + std::to_string(line) +
                ": a byte-order mark is within the text; remove it");
  }
  if (text.find('\r') == std::string::npos) return text;
  size_t end = 0;
  for (size_t i = 0; i < text.size(); ++i) {
    const bool is_before_line_feed = i + 1 < text.size() && text[i + 1] == '\n';
    if (text[i] == '\r' && is_before_line_feed) continue;
    text[end++] = text[i] == '\r' ? '\n' : text[i];
  }
  text.resize(end);
  return text;
}

std::string ReadText(const std::filesystem::path& path,
                     const std::string& what) {
  return NormalizeText(ReadFile(path, what), NameOf(path, what));
}

TextLines::TextLines(const std::filesystem::path& path, const std::string& what)
    : TextLines(Source{NameOf(path, what), ReadText(path, what)}) {}

TextLines TextLines::Of(std::string text, const std::string& what) {
  return TextLines(Source{what, NormalizeText(std::move(text), what)});
}

bool TextLines::Next() {
  const std::string_view text = source_.text;
  if (position_ >= text.size()) {
    line_ = {};
    return false;
  }
  const size_t end = std::min(text.find('\n', position_), text.size());
  line_ = TrimBlanks(text.substr(position_, end - position_));
  position_ = end + 1;
  ++number_;
  return true;
}

bool TextLines::NextContent() {
  while (Next()) {
    if (!line_.empty() && line_.front() != '#') return true;
  }
  return false;
}

std::string TextLines::Place() const {
  return source_.what + ", line " + std::to_string(number_);
}

double TextLines::Number(std::string_view word) const {
  if (const std::optional<double> number = ParseDouble(word)) return *number;
  Throw("has '" + Printable(word) +
        "' where a finite number should be; correct it");
}

void TextLines::Throw(const std::string& problem) const {
  throw Error(Place() + ": " + problem);
}

std::string_view TrimBlanks(std::string_view text) {
  const size_t first = text.find_first_not_of(kBlanks);
  if (first == std::string_view::npos) return {};
  return text.substr(first, text.find_last_not_of(kBlanks) + 1 - first);
}

std::string_view TakeWord(std::string_view* text) {
  const size_t first = std::min(text->find_first_not_of(kBlanks), text->size());
  const size_t end =
      std::min(text->find_first_of(kBlanks, first), text->size());
  const std::string_view word = text->substr(first, end - first);
  text->remove_prefix(end);
  return word;
}

std::vector<std::string_view> SplitWords(std::string_view line) {
  std::vector<std::string_view> words;
  for (std::string_view word = TakeWord(&line); !word.empty();
       word = TakeWord(&line)) {
    words.push_back(word);
  }
  return words;
}

std::vector<std::string> SplitFields(std::string_view line, char separator) {
  std::vector<std::string> fields;
  while (true) {
    const size_t end = std::min(line.find(separator), line.size());
    fields.emplace_back(TrimBlanks(line.substr(0, end)));
    if (end == line.size()) return fields;
    line.remove_prefix(end + 1);
  }
}

std::optional<std::vector<std::string>> SplitCsv(std::string_view line) {
  std::vector<std::string> fields(1);
  bool is_quoted = false;
  for (size_t i = 0; i < line.size(); ++i) {
    const bool is_escaped_quote = is_quoted && line.substr(i, 2) == "\"\"";
    if (line[i] == '"' && !is_escaped_quote) {
      is_quoted = !is_quoted;
    } else if (line[i] == ',' && !is_quoted) {
      fields.emplace_back();
    } else {
      fields.back() += line[i];
      if (is_escaped_quote) ++i;
    }
  }
  if (is_quoted) return std::nullopt;
  return fields;
}

std::optional<std::vector<double>> ParseNumbers(std::string_view line) {
  std::vector<double> numbers;
  for (const std::string_view word : SplitWords(line)) {
    const std::optional<double> number = ParseDouble(word);
    if (!number) return std::nullopt;
    numbers.push_back(*number);
  }
  return numbers;
}

std::optional<NamedWords> SplitNamedWords(std::string_view line,
                                          size_t num_words) {
  NamedWords split;
  split.words.resize(num_words);
  line = TrimBlanks(line);
  for (size_t k = num_words; k-- > 0;) {
    const size_t blank = line.find_last_of(kBlanks);
    if (blank == std::string_view::npos) return std::nullopt;
    split.words[k] = line.substr(blank + 1);
    line = TrimBlanks(line.substr(0, blank));
  }
  split.name = line;
  return split;
}

}  // namespace mgsfm

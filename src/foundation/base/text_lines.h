// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <cstddef>
#include <filesystem>
#include <optional>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

namespace mgsfm {

// The common rules of all readers of text.
//
// - A line ends with LF, CR LF or CR; the last one may lack its end.
// - A byte-order mark of UTF-8 is skipped at the start, and an error elsewhere.
//   UTF-16 and null bytes are errors.
// - Spaces and tabs around a line and before a word are ignored.
// - A comment is a line that starts with '#'.
// - A word is a number only if all of it parses (ParseDouble).

// The content of a text file, with LF at the ends of lines and without a
// byte-order mark. `what` names the file in messages, by default its path in
// quotes. Throws Error, naming the file, if it cannot be read or is not text.
std::string ReadText(const std::filesystem::path& path,
                     const std::string& what = "");

// The same for text from another source.
std::string NormalizeText(std::string text, const std::string& what);

class TextLines {
 public:
  explicit TextLines(const std::filesystem::path& path,
                     const std::string& what = "");
  // The lines of a text; `what` names it in messages.
  static TextLines Of(std::string text, const std::string& what);
  // Lines refer to the text.
  TextLines(const TextLines&) = delete;
  TextLines& operator=(const TextLines&) = delete;

  // Goes to the next line, which may be empty; false at the end.
  bool Next();
  // Goes to the next line that is neither empty nor a comment.
  bool NextContent();

  // The current line without surrounding blanks. Valid until this object is
  // destroyed.
  std::string_view line() const { return line_; }
  int number() const { return number_; }
  // "'poses.txt', line 3"
  std::string Place() const;
  // The number that a word of the line must be.
  double Number(std::string_view word) const;
  // Throws "'poses.txt', line 3: problem".
  [[noreturn]] void Throw(const std::string& problem) const;

 private:
  struct Source {
    std::string what, text;
  };
  explicit TextLines(Source source) : source_(std::move(source)) {}

  Source source_;
  size_t position_ = 0;
  std::string_view line_;
  int number_ = 0;
};

// The text without the blanks and tabs around it.
std::string_view TrimBlanks(std::string_view text);

// Removes the first word of `text` and the blanks before it; empty at the end.
std::string_view TakeWord(std::string_view* text);

std::vector<std::string_view> SplitWords(std::string_view line);

// Fields between separators, without the blanks around them; they may be
// empty.
std::vector<std::string> SplitFields(std::string_view line, char separator);

// Fields of CSV (RFC 4180); a field in double quotes may contain commas, and
// quotes as "". nullopt if a quote is not closed.
std::optional<std::vector<std::string>> SplitCsv(std::string_view line);

// The numbers in a line; nullopt if any word is not a number.
std::optional<std::vector<double>> ParseNumbers(std::string_view line);

// A name, which may contain blanks, and the last words of its line.
struct NamedWords {
  std::string name;
  std::vector<std::string_view> words;
};

// nullopt if the line has no name before its last `num_words` words.
std::optional<NamedWords> SplitNamedWords(std::string_view line,
                                          size_t num_words);

}  // namespace mgsfm

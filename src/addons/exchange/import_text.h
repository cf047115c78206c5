// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <cstdint>
#include <filesystem>
#include <string>
#include <string_view>

namespace mgsfm {

// The words and lines of a text file. All functions throw Error, naming the
// file and the line, what was expected there, and what was found.
class ImportText {
 public:
  explicit ImportText(const std::filesystem::path& path);

  // The next words, across lines.
  double Number(const char* expected);
  uint64_t Count(const char* expected);
  uint8_t Color(const char* expected);

  // The rest of the current line, without the blanks around it.
  std::string_view RestOfLine();
  // The next line that is not blank, without the blanks around it; empty at the
  // end of the file.
  std::string_view NextLine();

  const std::filesystem::path& path() const { return path_; }
  [[noreturn]] void Throw(const std::string& problem) const;
  [[noreturn]] void ThrowUnexpected(const char* expected,
                                    std::string_view found) const;

 private:
  std::string_view Word(const char* expected);

  std::filesystem::path path_;
  std::string text_;
  size_t position_ = 0;
  int line_ = 1;
};

}  // namespace mgsfm

// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <ios>
#include <locale>
#include <sstream>
#include <string>

namespace mgsfm {

// String streams that throw std::bad_alloc if memory is lacking; those of the
// standard library catch it, and the text seems to end there. They do not
// depend on the locale of the process.
class TextInput : public std::istringstream {
 public:
  explicit TextInput(const std::string& text = "") : std::istringstream(text) {
    imbue(std::locale::classic());
    exceptions(std::ios::badbit);
  }
};

class TextOutput : public std::ostringstream {
 public:
  TextOutput() {
    imbue(std::locale::classic());
    exceptions(std::ios::badbit);
  }
};

}  // namespace mgsfm

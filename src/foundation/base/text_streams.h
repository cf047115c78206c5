// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <ios>
#include <locale>
#include <sstream>
#include <string>

namespace mgsfm {

// String streams that throw std::bad_alloc if memory runs out; standard streams
// catch it, so the text seems to end there. They ignore the locale.
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

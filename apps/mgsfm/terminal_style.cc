// SPDX-License-Identifier: BSD-3-Clause
#include "terminal_style.h"

#include <unistd.h>

#include <cstdlib>

namespace mgsfm {
namespace {

std::string Variable(const char* name) {
  const char* value = std::getenv(name);
  return value == nullptr ? "" : value;
}

}  // namespace

bool ErrorStreamIsTerminal() {
  const std::string kind = Variable("TERM");
  return isatty(STDERR_FILENO) != 0 && !kind.empty() && kind != "dumb";
}

std::string Colored(Color color, const std::string& text) {
  if (!ErrorStreamIsTerminal() || !Variable("NO_COLOR").empty()) return text;
  return "\033[" + std::to_string(static_cast<int>(color)) + "m" + text +
         "\033[0m";
}

}  // namespace mgsfm

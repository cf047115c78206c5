// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <string>

namespace mgsfm {

// The standard error stream is a terminal that can overwrite a line.
bool ErrorStreamIsTerminal();

enum class Colour { kRed = 31, kYellow = 33 };

// The text for the standard error stream: coloured on a terminal, unless the
// variable NO_COLOR is set (no-color.org).
std::string Coloured(Colour colour, const std::string& text);

}  // namespace mgsfm

// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <string>

namespace mgsfm {

// The standard error stream is a terminal that can overwrite a line.
bool ErrorStreamIsTerminal();

enum class Color { kRed = 31, kYellow = 33 };

// The text for the standard error stream: colored on a terminal, unless the
// variable NO_COLOR is set (no-color.org).
std::string Colored(Color color, const std::string& text);

}  // namespace mgsfm

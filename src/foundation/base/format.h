// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <string>

namespace mgsfm {

// The text that printf would print.
[[gnu::format(printf, 1, 2)]] std::string Formatted(const char* format, ...);

}  // namespace mgsfm

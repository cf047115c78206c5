// SPDX-License-Identifier: BSD-3-Clause
#include "base/format.h"

#include <cstdarg>
#include <cstdio>

#include "mgsfm/base/error.h"

namespace mgsfm {

std::string Formatted(const char* format, ...) {
  std::va_list arguments, again;
  va_start(arguments, format);
  va_copy(again, arguments);
  const int size = std::vsnprintf(nullptr, 0, format, arguments);
  va_end(arguments);
  MGSFM_CHECK(size >= 0);
  std::string text(static_cast<size_t>(size) + 1, '\0');
  std::vsnprintf(text.data(), text.size(), format, again);
  va_end(again);
  text.pop_back();
  return text;
}

}  // namespace mgsfm

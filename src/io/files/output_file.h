// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <filesystem>
#include <string>

namespace mgsfm {

// Writes a file as a whole, replacing one of that name. Throws Error, naming
// the file and the reason, if it cannot be written completely.
void WriteFile(const std::filesystem::path& path, const std::string& content);

// The Error for a file, or folder, on which the last write failed; the reason
// is taken from errno.
[[noreturn]] void ThrowWriteError(const std::filesystem::path& path);

}  // namespace mgsfm

// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <filesystem>
#include <string>

namespace mgsfm {

// Writes a file, replacing one of that name. Throws Error, naming the file and
// the reason, if it cannot be written completely.
void WriteFile(const std::filesystem::path& path, const std::string& content);

// Throws the Error for a failed write to a file or folder, with the reason in
// errno.
[[noreturn]] void ThrowWriteError(const std::filesystem::path& path);

}  // namespace mgsfm

// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <cstddef>
#include <filesystem>
#include <limits>
#include <string>

namespace mgsfm {

// The content of a file. Throws Error, naming the file and the reason, if it is
// a folder or cannot be read completely. `what` names the file in messages,
// e.g. "rig configuration 'rig.json'"; its path by default. Reads no more than
// `max_size` bytes.
//
// All files are read through this function, because streams mistake a disk
// failure for the end of the file.
std::string ReadFile(const std::filesystem::path& path,
                     const std::string& what = "",
                     size_t max_size = std::numeric_limits<size_t>::max());

}  // namespace mgsfm

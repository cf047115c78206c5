// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <string>

namespace mgsfm {

// "MAJOR.MINOR.PATCH" by semantic versioning, as stated in reports and
// configuration files.
const char* Version();

// Whether a file of this version may have contents that this program does not
// know: its major or minor version is higher. Throws Error for malformed text.
bool IsNewerVersion(const std::string& version);

}  // namespace mgsfm

// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <string>

namespace mgsfm {

// "MAJOR.MINOR.PATCH", by the rules of semantic versioning. Reports and
// configuration files state it.
const char* Version();

// Whether a file of that version may hold what this one does not know: its
// major or minor version is higher. Throws Error if the text is no version.
bool IsNewerVersion(const std::string& version);

}  // namespace mgsfm

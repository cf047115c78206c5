// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <string>

namespace mgsfm {

// The text of `mgsfm --version`: the version, the commit, the compiler and the
// libraries.
std::string VersionText(const std::string& commit);

}  // namespace mgsfm

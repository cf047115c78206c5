// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <string>
#include <vector>

namespace mgsfm {

// The whole program; called once in a process. Returns its exit code. The
// commit is for --version.
int RunProgram(const std::vector<std::string>& arguments,
               const std::string& commit = "unknown");

}  // namespace mgsfm

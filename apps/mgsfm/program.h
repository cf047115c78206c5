// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <string>
#include <vector>

namespace mgsfm {

// The call of this process; empty without RunProgram().
struct ProgramCall {
  std::string command;  // the words, quoted where a shell needs it
  std::string commit;   // of the sources
};
const ProgramCall& ThisCall();

// The whole program; called once in a process. Returns its exit code. The
// commit is for --version and reports.
int RunProgram(const std::vector<std::string>& arguments,
               const std::string& commit = "unknown");

}  // namespace mgsfm

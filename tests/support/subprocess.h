// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <sys/wait.h>

#include <cstdlib>
#include <string>

#include "support/temp_dir.h"

namespace mgsfm {

struct CommandOutput {
  int exit_code = -1;  // 128 + signal if it was killed by one
  std::string out;
  std::string err;
};

// The exit status as reported by a shell.
inline int ExitCodeOf(int status) {
  return WIFEXITED(status) ? WEXITSTATUS(status) : 128 + WTERMSIG(status);
}

// Runs a shell command and waits for it.
inline CommandOutput RunShell(const std::string& command) {
  const TempDir dir;
  const std::string out_path = (dir.path() / "out").string();
  const std::string err_path = (dir.path() / "err").string();
  const int status = std::system(
      ("{ " + command + "\n} >" + out_path + " 2>" + err_path).c_str());
  return {ExitCodeOf(status), ReadTextFile(out_path), ReadTextFile(err_path)};
}

}  // namespace mgsfm

// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <fcntl.h>
#include <sys/wait.h>
#include <unistd.h>

#include <cerrno>
#include <csignal>
#include <string>
#include <vector>

#include "cli/program_runs.h"

namespace mgsfm {

// The program, running beside the test, and what it says.
class RunningProgram {
 public:
  explicit RunningProgram(std::vector<std::string> arguments) {
    int ends[2];
    MGSFM_CHECK(pipe2(ends, O_CLOEXEC) == 0);
    arguments.insert(arguments.begin(), MGSFM_EXECUTABLE);
    std::vector<char*> argv;
    for (std::string& argument : arguments) argv.push_back(argument.data());
    argv.push_back(nullptr);
    pid_ = fork();
    MGSFM_CHECK(pid_ >= 0);
    if (pid_ == 0) {
      dup2(ends[1], STDERR_FILENO);
      execv(argv[0], argv.data());
      _exit(127);
    }
    close(ends[1]);
    from_program_ = ends[0];
  }
  ~RunningProgram() {
    if (is_running_) kill(pid_, SIGKILL);
    End();
    close(from_program_);
  }
  RunningProgram(const RunningProgram&) = delete;
  RunningProgram& operator=(const RunningProgram&) = delete;

  void WaitUntilItSays(const std::string& text) {
    while (output_.err.find(text) == std::string::npos && Read()) {
    }
    EXPECT_THAT(output_.err, testing::HasSubstr(text));
  }
  void Send(int signal) const { kill(pid_, signal); }

  // Waits for it; exit codes are those of a shell.
  CommandOutput End() {
    while (Read()) {
    }
    if (is_running_) {
      int status = 0;
      waitpid(pid_, &status, 0);
      is_running_ = false;
      output_.exit_code = ExitCodeOf(status);
      ended_by_signal_ = WIFSIGNALED(status);
    }
    return output_;
  }
  bool EndedBySignal() const { return ended_by_signal_; }

 private:
  bool Read() {
    char buffer[4096];
    ssize_t size = 0;
    do {
      size = read(from_program_, buffer, sizeof(buffer));
    } while (size < 0 && errno == EINTR);
    if (size <= 0) return false;
    output_.err.append(buffer, static_cast<size_t>(size));
    return true;
  }

  pid_t pid_ = -1;
  int from_program_ = -1;
  bool is_running_ = true;
  bool ended_by_signal_ = false;
  CommandOutput output_;
};

}  // namespace mgsfm

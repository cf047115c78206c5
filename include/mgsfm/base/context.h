// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <cstdint>
#include <functional>
#include <string>
#include <string_view>

namespace mgsfm {

enum class LogLevel { kDebug, kInfo, kWarning, kError };

// Progress of a long step: `done` of `total` units of work.
struct Progress {
  std::string_view stage;
  size_t done = 0;
  size_t total = 0;
};

// What a stage may use of the outside: threads, seed, log, progress, and
// whether it shall stop. The library itself prints nothing; a null callback is
// silence. `log` and `progress` are only called from the thread that called the
// stage, `is_cancelled` from any.
struct Context {
  int num_threads = 1;
  uint64_t random_seed = 0;
  std::function<void(LogLevel, const std::string&)> log;
  std::function<void(const Progress&)> progress;
  std::function<bool()> is_cancelled;

  void Debug(const std::string& message) const;
  void Info(const std::string& message) const;
  void Warning(const std::string& message) const;
  // Also checks for an interruption.
  void ReportProgress(std::string_view stage, size_t done, size_t total) const;
  // Throws Interrupted if the run shall stop. Everything that may take longer
  // than a second calls it, or ReportProgress, a few times a second.
  void CheckInterrupted() const;
};

}  // namespace mgsfm

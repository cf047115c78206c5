// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <cstdint>
#include <functional>
#include <string>
#include <string_view>

namespace mgsfm {

enum class LogLevel { kDebug, kInfo, kWarning, kError };

// Progress of a long-running step: `done` of `total` units of work.
struct Progress {
  std::string_view stage;
  size_t done = 0;
  size_t total = 0;
};

// The environment of a stage: threads, random seed, logging, progress and
// cancellation. The library itself prints nothing; null callbacks are ignored.
// `log` and `progress` are called only from the thread that called the stage,
// `is_canceled` from any thread.
struct Context {
  int num_threads = 1;
  uint64_t random_seed = 0;
  std::function<void(LogLevel, const std::string&)> log;
  std::function<void(const Progress&)> progress;
  std::function<bool()> is_canceled;

  void Debug(const std::string& message) const;
  void Info(const std::string& message) const;
  void Warning(const std::string& message) const;
  // Also calls CheckInterrupted().
  void ReportProgress(std::string_view stage, size_t done, size_t total) const;
  // Throws Interrupted if cancellation was requested. Code that may run longer
  // than a second calls this or ReportProgress() several times per second.
  void CheckInterrupted() const;
};

}  // namespace mgsfm

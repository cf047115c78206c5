// SPDX-License-Identifier: BSD-3-Clause
#include <unistd.h>

#include <chrono>
#include <cstdio>
#include <memory>
#include <string>
#include <utility>

#include "base/text.h"
#include "command.h"
#include "interruption.h"
#include "mgsfm/base/timer.h"

namespace mgsfm {
namespace {

// The standard error stream: log lines, and below them, on a terminal only,
// one line of progress that is overwritten.
class Terminal {
 public:
  explicit Terminal(LogLevel log_level)
      : shows_progress_(log_level <= LogLevel::kInfo &&
                        isatty(STDERR_FILENO) != 0) {}

  void Log(LogLevel level, const std::string& message) {
    ClearProgress();
    const std::string_view name = EnumName(level);
    std::fprintf(stderr, "%8.2f %-7.*s %s\n", since_start_.Seconds(),
                 static_cast<int>(name.size()), name.data(),
                 Printable(message).c_str());
  }

  void ShowProgress(const Progress& progress) {
    if (!shows_progress_ || progress.total == 0) return;
    if (progress.stage != stage_) {
      stage_ = progress.stage;
      since_stage_start_ = Timer();
      since_shown_ = Timer();
      return;
    }
    if (progress.done >= progress.total) {
      ClearProgress();
      stage_.clear();  // it may run once more, for another part of the scene
      return;
    }
    // Often enough for the eye, seldom enough to cost nothing.
    if (progress.done == 0 || since_shown_.Seconds() < 0.1) return;
    since_shown_ = Timer();
    const double seconds = since_stage_start_.Seconds();
    const double num_left = static_cast<double>(progress.total - progress.done);
    const double per_second = static_cast<double>(progress.done) / seconds;
    std::fprintf(stderr, "\r\033[K%s: %zu of %zu, %.3g/s, %.0f s left",
                 stage_.c_str(), progress.done, progress.total, per_second,
                 num_left / per_second);
    std::fflush(stderr);
    progress_is_shown_ = true;
  }

  void ClearProgress() {
    if (progress_is_shown_) std::fprintf(stderr, "\r\033[K");
    progress_is_shown_ = false;
  }

  ~Terminal() { ClearProgress(); }
  Terminal(const Terminal&) = delete;
  Terminal& operator=(const Terminal&) = delete;

 private:
  bool shows_progress_;
  bool progress_is_shown_ = false;
  std::string stage_;
  Timer since_start_;
  Timer since_stage_start_;
  Timer since_shown_;
};

}  // namespace

Context MakeTerminalContext(const CommonOptions& options) {
  const auto terminal = std::make_shared<Terminal>(options.log_level);
  Context context;
  context.log = [terminal](LogLevel level, const std::string& message) {
    terminal->Log(level, message);
  };
  context.progress = [terminal](const Progress& progress) {
    terminal->ShowProgress(progress);
  };
  context.is_cancelled = [] { return InterruptionSignal() != 0; };
  return ApplyCommonOptions(options, std::move(context));
}

}  // namespace mgsfm

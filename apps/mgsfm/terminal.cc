// SPDX-License-Identifier: BSD-3-Clause
#include <sys/ioctl.h>
#include <unistd.h>

#include <algorithm>
#include <cstdio>
#include <map>
#include <memory>
#include <string>
#include <utility>

#include "base/grouped_warnings.h"
#include "base/text.h"
#include "command.h"
#include "interruption.h"
#include "mgsfm/base/timer.h"
#include "progress_text.h"
#include "terminal_style.h"

namespace mgsfm {
namespace {

// Often enough for the eye, seldom enough to cost nothing.
constexpr double kTerminalInterval_s = 0.1;
// Elsewhere (nohup, CI), a log must not look dead, nor grow long.
constexpr double kLogInterval_s = 60.0;

// One for each camera of a large rig.
constexpr size_t kMaxWarningsOfAKind = 10;

// Cuts a line that would wrap, which could not be overwritten.
std::string FitToTerminal(std::string line) {
  winsize size{};
  if (ioctl(STDERR_FILENO, TIOCGWINSZ, &size) == 0 && size.ws_col > 1) {
    line.resize(std::min<size_t>(line.size(), size.ws_col - 1));
  }
  return line;
}

std::string NameOf(LogLevel level) {
  char name[16];
  const std::string_view text = EnumName(level);
  std::snprintf(name, sizeof(name), "%-7.*s", static_cast<int>(text.size()),
                text.data());
  if (level == LogLevel::kError) return Colored(Color::kRed, name);
  if (level == LogLevel::kWarning) return Colored(Color::kYellow, name);
  return name;
}

// The standard error stream: log lines, and below them, on a terminal, one line
// of progress that is overwritten. Elsewhere progress is a log line.
class Terminal {
 public:
  explicit Terminal(LogLevel log_level)
      : log_level_(log_level),
        is_terminal_(ErrorStreamIsTerminal()),
        progress_(is_terminal_ ? kTerminalInterval_s : kLogInterval_s) {}

  void Log(LogLevel level, const std::string& message) {
    if (level == LogLevel::kWarning && !IsShown(message)) return;
    ClearProgress();
    Print(level, message);
    if (!is_terminal_) progress_.Postpone(since_start_.Seconds());
  }

  void ShowProgress(const Progress& progress) {
    if (log_level_ > LogLevel::kInfo) return;
    const auto line = progress_.Update(progress, since_start_.Seconds());
    if (!line) {
      if (progress.done >= progress.total) ClearProgress();
    } else if (is_terminal_) {
      ShowLine(*line);
    } else {
      Log(LogLevel::kInfo, *line);
    }
  }

  ~Terminal() {
    ClearProgress();
    for (const auto& [kind, repeated] : repeated_) {
      if (repeated.count <= kMaxWarningsOfAKind) continue;
      Print(LogLevel::kWarning,
            std::to_string(repeated.count - kMaxWarningsOfAKind) +
                " more warnings are like this: " + repeated.last);
    }
  }
  Terminal(const Terminal&) = delete;
  Terminal& operator=(const Terminal&) = delete;

 private:
  struct Repeated {
    size_t count = 0;
    std::string last;
  };

  void Print(LogLevel level, const std::string& message) const {
    std::fprintf(stderr, "%8.2f %s %s\n", since_start_.Seconds(),
                 NameOf(level).c_str(), Printable(message).c_str());
  }

  // Many warnings of one kind would hide the others.
  bool IsShown(const std::string& message) {
    Repeated& repeated = repeated_[KindOfMessage(message)];
    repeated.last = message;
    return ++repeated.count <= kMaxWarningsOfAKind;
  }

  void ShowLine(const std::string& text) {
    constexpr int kBarWidth = 20;  // characters: 5 % each
    const std::string line =
        FitToTerminal(ProgressBar(progress_.Share(), kBarWidth) + " " + text);
    std::fprintf(stderr, "\r\033[K%s", line.c_str());
    std::fflush(stderr);
    progress_is_shown_ = true;
  }

  void ClearProgress() {
    if (progress_is_shown_) std::fprintf(stderr, "\r\033[K");
    progress_is_shown_ = false;
  }

  LogLevel log_level_;
  bool is_terminal_;
  bool progress_is_shown_ = false;
  Timer since_start_;
  ProgressText progress_;
  std::map<std::string, Repeated> repeated_;  // warnings, by their kind
};

}  // namespace

Context MakeTerminalContext(const CommonOptions& options) {
  const auto terminal = std::make_shared<Terminal>(options.MinLogLevel());
  Context context;
  context.log = [terminal](LogLevel level, const std::string& message) {
    terminal->Log(level, message);
  };
  context.progress = [terminal](const Progress& progress) {
    terminal->ShowProgress(progress);
  };
  context.is_canceled = [] { return InterruptionSignal() != 0; };
  return ApplyCommonOptions(options, std::move(context));
}

}  // namespace mgsfm

// SPDX-License-Identifier: BSD-3-Clause
#include "terminal.h"

#include <sys/ioctl.h>
#include <unistd.h>

#include <algorithm>
#include <atomic>
#include <cerrno>
#include <cmath>
#include <csignal>
#include <cstdio>
#include <cstdlib>
#include <ctime>
#include <map>
#include <memory>
#include <utility>

#include "base/format.h"
#include "base/grouped_warnings.h"
#include "base/text.h"
#include "command.h"
#include "mgsfm/base/timer.h"

namespace mgsfm {
namespace {

std::string Variable(const char* name) {
  const char* value = std::getenv(name);
  return value == nullptr ? "" : value;
}

// Whether the standard error stream is a terminal that can overwrite a line.
bool ErrorStreamIsTerminal() {
  const std::string kind = Variable("TERM");
  return isatty(STDERR_FILENO) != 0 && !kind.empty() && kind != "dumb";
}

}  // namespace

std::string Colored(TerminalColor color, const std::string& text) {
  if (!ErrorStreamIsTerminal() || !Variable("NO_COLOR").empty()) return text;
  return "\033[" + std::to_string(static_cast<int>(color)) + "m" + text +
         "\033[0m";
}

namespace {

constexpr int kSignals[] = {SIGINT, SIGTERM, SIGHUP};
// `timeout` and terminals may send the same signal twice at once.
constexpr int64_t kPatienceSeconds = 2;

// A handler can share nothing else with the program.
std::atomic<int> first_signal{0};
std::atomic<int64_t> first_time{0};
static_assert(std::atomic<int>::is_always_lock_free &&
              std::atomic<int64_t>::is_always_lock_free);

// Only calls functions that are safe in a handler.
void OnSignal(int signal) {
  const int saved_errno = errno;
  timespec now{};
  clock_gettime(CLOCK_MONOTONIC, &now);
  int none = 0;
  if (first_signal.compare_exchange_strong(none, signal)) {
    first_time = now.tv_sec;
  } else if (now.tv_sec - first_time >= kPatienceSeconds) {
    std::signal(signal, SIG_DFL);
    raise(signal);
  }
  errno = saved_errno;
}

}  // namespace

void CatchInterruptions() {
  for (const int signal : kSignals) {
    struct sigaction action {};
    sigaction(signal, nullptr, &action);
    if (action.sa_handler == SIG_IGN) continue;
    action.sa_handler = OnSignal;
    action.sa_flags = SA_RESTART;
    sigemptyset(&action.sa_mask);
    sigaction(signal, &action, nullptr);
  }
}

int InterruptionSignal() { return first_signal; }

int EndByInterruption() {
  const int signal = InterruptionSignal();
  std::signal(signal, SIG_DFL);
  raise(signal);
  return 128 + signal;
}

std::string FormatTimeLeft(double seconds) {
  if (seconds <= 60.0) return Formatted("%.0f s", std::ceil(seconds));
  // An estimate of more than a century is meaningless.
  constexpr double kMaxMinutes = 60.0 * 24.0 * 36525.0;
  const auto minutes =
      static_cast<long>(std::min(std::ceil(seconds / 60.0), kMaxMinutes));
  if (minutes < 60) return Formatted("%ld min", minutes);
  return Formatted("%ld h %02ld min", minutes / 60, minutes % 60);
}

std::string ProgressBar(double share, int width) {
  const int num_done = static_cast<int>(std::clamp(share, 0.0, 1.0) *
                                        static_cast<double>(width));
  std::string bar(static_cast<size_t>(num_done), '=');
  if (num_done < width) bar += '>';
  bar.resize(static_cast<size_t>(width), ' ');
  return "[" + bar + "]";
}

std::optional<std::string> ProgressText::Update(const Progress& progress,
                                                double now_s) {
  if (progress.total == 0 || progress.done >= progress.total) {
    stage_.clear();
    return std::nullopt;
  }
  // The same stage may run once more, for another part of the scene.
  if (progress.stage != stage_ || progress.done < num_done_) {
    Start(progress, now_s);
  }
  num_done_ = progress.done;
  if (progress.total != total_) estimating_stage_ = stage_;
  const bool is_estimate = estimating_stage_ == stage_;
  share_ =
      static_cast<double>(progress.done) / static_cast<double>(progress.total);
  const auto num_new = static_cast<double>(progress.done - start_.num_done);
  if (num_new == 0.0 || now_s - shown_s_ < interval_s_) return std::nullopt;
  shown_s_ = now_s;
  const double per_second = num_new / std::max(1e-9, now_s - start_.time_s);
  std::string line =
      stage_ +
      Formatted(": %zu of %s%zu, ", progress.done, is_estimate ? "about " : "",
                progress.total) +
      Formatted(per_second < 1000.0 ? "%.3g/s" : "%.0f/s", per_second);
  if (is_estimate) return line;
  if (const auto left_s = Forecast(progress, now_s)) {
    line += ", " + FormatTimeLeft(*left_s) + " left";
  }
  return line;
}

void ProgressText::Start(const Progress& progress, double now_s) {
  stage_ = progress.stage;
  start_ = {now_s, progress.done};
  total_ = progress.total;
  mark_.reset();
}

std::optional<double> ProgressText::Forecast(const Progress& progress,
                                             double now_s) {
  const Mark& since = mark_ ? *mark_ : start_;
  if (progress.done == since.num_done) return std::nullopt;
  const double left_s = static_cast<double>(progress.total - progress.done) *
                        (now_s - since.time_s) /
                        static_cast<double>(progress.done - since.num_done);
  const double end_s = now_s + left_s;
  const bool holds =
      !mark_ || (now_s <= mark_->end_s &&
                 end_s - mark_->end_s <= 0.5 * (mark_->end_s - mark_->time_s));
  if (!mark_ ||
      now_s - start_.time_s >= 2.0 * (mark_->time_s - start_.time_s)) {
    mark_ = {now_s, progress.done, end_s};
  }
  if (!holds) return std::nullopt;
  return left_s;
}

namespace {

// Often enough for the eye, rarely enough to cost nothing.
constexpr double kTerminalInterval_s = 0.1;
// Elsewhere (nohup, CI), a log must neither look dead nor grow long.
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
  std::string name(EnumName(level));
  name.resize(7, ' ');
  if (level == LogLevel::kError) return Colored(TerminalColor::kRed, name);
  if (level == LogLevel::kWarning) return Colored(TerminalColor::kYellow, name);
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
    if (progress.total == 0) stage_ = progress.stage;
    if (!line) {
      if (progress.done >= progress.total) ShowStage(progress.stage);
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

  // A stage whose amount of work is unknown, or that has done a step of it.
  void ShowStage(std::string_view stage) {
    ClearProgress();
    if (!is_terminal_ || stage != stage_) return;
    std::fprintf(stderr, "%s", FitToTerminal(stage_).c_str());
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
  std::string stage_;                         // that has announced itself last
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

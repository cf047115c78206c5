// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <optional>
#include <string>

#include "mgsfm/base/context.h"

namespace mgsfm {

enum class TerminalColor { kRed = 31, kYellow = 33 };

// The text for the standard error stream: colored on a terminal, unless the
// variable NO_COLOR is set (no-color.org).
std::string Colored(TerminalColor color, const std::string& text);

// Turns SIGINT, SIGTERM and SIGHUP into requests to stop cleanly, which
// Context::is_canceled reports. Signals that the caller ignores remain ignored
// (nohup, background jobs). A signal two or more seconds after the first ends
// the process at once.
void CatchInterruptions();

// The first signal that was caught, or 0.
int InterruptionSignal();

// Ends the process by this signal, as if it had not been caught: only then do
// shells and make stop, too. If the signal cannot end the process (PID 1 of a
// container), returns the exit code that a shell would show.
int EndByInterruption();

// "40 s", "5 min" or "1 h 05 min". Rounds up, so that it is 0 s only at the
// end.
std::string FormatTimeLeft(double seconds);

// "[=====>    ]" with `width` characters between the brackets.
std::string ProgressBar(double share, int width);

// Turns the progress that stages report into lines for a reader, at most one
// per interval. Times are seconds on any clock.
//
// The remaining time follows from the growth since a mark in the last two
// thirds of the stage. It is shown only while the forecast of that mark holds:
// its end is not over, and the present one is later by at most half the time
// that was forecast. Stages that only estimate their total, such as solvers
// their iterations, have none: they go on for long when little seems to be
// left.
class ProgressText {
 public:
  explicit ProgressText(double interval_s) : interval_s_(interval_s) {}

  // "matching: 20 of 80, 4/s, 15 s left", if it is time for it.
  std::optional<std::string> Update(const Progress& progress, double now_s);
  // The fraction of the stage that was done at the last update.
  double Share() const { return share_; }
  // The reader has just seen another line.
  void Postpone(double now_s) { shown_s_ = now_s; }

 private:
  // A moment of the stage, and when its work was expected to end then.
  struct Mark {
    double time_s = 0.0;
    size_t num_done = 0;
    double end_s = 0.0;
  };

  void Start(const Progress& progress, double now_s);
  // The time left, unless earlier forecasts of the stage were wrong.
  std::optional<double> Forecast(const Progress& progress, double now_s);

  double interval_s_;
  std::string stage_;
  Mark start_;
  std::optional<Mark> mark_;
  size_t num_done_ = 0;
  size_t total_ = 0;
  std::string estimating_stage_;  // the last one whose total changed
  double shown_s_ = 0.0;
  double share_ = 0.0;
};

}  // namespace mgsfm

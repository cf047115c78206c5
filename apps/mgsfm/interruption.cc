// SPDX-License-Identifier: BSD-3-Clause
#include "interruption.h"

#include <atomic>
#include <cerrno>
#include <csignal>
#include <ctime>

namespace mgsfm {
namespace {

constexpr int kSignals[] = {SIGINT, SIGTERM, SIGHUP};
// `timeout` and terminals may send the same signal twice at a time.
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

}  // namespace mgsfm

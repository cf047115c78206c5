// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <chrono>
#include <string>

namespace mgsfm {

// Wall-clock seconds since construction. Used for reports only: no result
// depends on time.
class Timer {
 public:
  double Seconds() const {
    return std::chrono::duration<double>(Clock::now() - start_).count();
  }

 private:
  using Clock = std::chrono::steady_clock;
  Clock::time_point start_ = Clock::now();
};

// CPU time of all threads of this process, and its peak resident memory so far.
// 0 if the system does not provide them.
double ProcessorSeconds();
double PeakMemoryMib();

// Resources used by a stage. The peak memory covers the process from its start
// to the end of the stage, so it never decreases between stages.
struct StageTime {
  std::string stage;
  double seconds = 0.0;
  double processor_seconds = 0.0;
  double peak_memory_mib = 0.0;
};

// Measures a stage from its construction. Used for reports only: no result
// depends on time.
class StageTimer {
 public:
  StageTimer() : processor_seconds_(ProcessorSeconds()) {}

  StageTime Stop(std::string stage) const;

 private:
  Timer timer_;
  double processor_seconds_;
};

}  // namespace mgsfm

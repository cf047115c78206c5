// SPDX-License-Identifier: BSD-3-Clause
#include "mgsfm/base/timer.h"

#include <sys/resource.h>

#include <utility>

namespace mgsfm {
namespace {

double ToSeconds(const timeval& time) {
  return static_cast<double>(time.tv_sec) +
         1e-6 * static_cast<double>(time.tv_usec);
}

}  // namespace

double ProcessorSeconds() {
  rusage usage{};
  if (getrusage(RUSAGE_SELF, &usage) != 0) return 0.0;
  return ToSeconds(usage.ru_utime) + ToSeconds(usage.ru_stime);
}

double PeakMemoryMib() {
  rusage usage{};
  if (getrusage(RUSAGE_SELF, &usage) != 0) return 0.0;
#ifdef __APPLE__
  constexpr double kUnitsPerMib = 1024.0 * 1024.0;  // bytes
#else
  constexpr double kUnitsPerMib = 1024.0;  // KiB
#endif
  return static_cast<double>(usage.ru_maxrss) / kUnitsPerMib;
}

StageTime StageTimer::Stop(std::string stage) const {
  return {std::move(stage), timer_.Seconds(),
          ProcessorSeconds() - processor_seconds_, PeakMemoryMib()};
}

}  // namespace mgsfm

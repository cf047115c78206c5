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
  constexpr double kKib = 1024.0;
  const double size = static_cast<double>(usage.ru_maxrss) / kKib;
#ifdef __APPLE__
  return size / kKib;  // ru_maxrss is in bytes
#else
  return size;  // in KiB
#endif
}

StageTime StageTimer::Stop(std::string stage) const {
  return {std::move(stage), timer_.Seconds(),
          ProcessorSeconds() - processor_seconds_, PeakMemoryMib()};
}

}  // namespace mgsfm

// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <string>

#include "mgsfm/base/timer.h"

namespace mgsfm {

// Of this process: time on processors, of all threads together, and the most
// memory it had until now. 0 where the system does not tell.
double ProcessorSeconds();
double PeakMemoryMib();

// What a stage took. The peak of memory is that of the process from its start
// to the end of the stage, so a stage raised it if the one before has less.
struct StageTime {
  std::string stage;
  double seconds = 0.0;
  double processor_seconds = 0.0;
  double peak_memory_mib = 0.0;
};

// Measures a stage from its construction. Only ever reported.
class StageTimer {
 public:
  StageTimer() : processor_seconds_(ProcessorSeconds()) {}

  StageTime Stop(std::string stage) const;

 private:
  Timer timer_;
  double processor_seconds_;
};

}  // namespace mgsfm

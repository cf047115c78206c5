// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <cstdio>
#include <string>
#include <vector>

#include "mgsfm/base/context.h"
#include "mgsfm/base/timer.h"

namespace mgsfm {

// Runs a stage, announces it as progress of unknown size (total 0), and logs
// and records its time.
template <class Function>
auto Timed(const char* stage, const Context& context,
           std::vector<StageTime>* times, const Function& function) {
  context.Debug(std::string(stage) + " started");
  context.ReportProgress(stage, 0, 0);
  const StageTimer timer;
  auto result = function();
  times->push_back(timer.Stop(stage));
  char seconds[32];
  std::snprintf(seconds, sizeof(seconds), "%.2f s", times->back().seconds);
  context.Info(std::string(stage) + ": " + seconds);
  return result;
}

}  // namespace mgsfm

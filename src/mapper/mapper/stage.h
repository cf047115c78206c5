// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <string>
#include <utility>
#include <vector>

#include "base/format.h"
#include "mgsfm/base/context.h"
#include "mgsfm/base/timer.h"

namespace mgsfm {

// A running stage: announces it as progress of unknown size (total 0), and logs
// and records its time.
class RunningStage {
 public:
  RunningStage(std::string name, const Context& context)
      : name_(std::move(name)), context_(context) {
    context.Debug(name_ + " started");
    context.ReportProgress(name_.c_str(), 0, 0);
  }
  void Finish(std::vector<StageTime>* times) const {
    times->push_back(timer_.Stop(name_));
    context_.Info(name_ + Formatted(": %.2f s", times->back().seconds));
  }

 private:
  std::string name_;
  const Context& context_;
  StageTimer timer_;
};

}  // namespace mgsfm

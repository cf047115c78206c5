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
// and records its time. The log, the progress and the report give it one name.
class RunningStage {
 public:
  RunningStage(std::string name, const Context& context)
      : name_(std::move(name)), context_(context), context_of_work_(context) {
    context.Debug(name_ + " started");
    context.ReportProgress(name_, 0, 0);
    if (!context.progress) return;
    context_of_work_.progress = [show = context.progress,
                                 name = name_](const Progress& step) {
      show({name, step.done, step.total});
    };
  }
  // For the work of the stage: its progress is that of the stage.
  const Context& context() const { return context_of_work_; }
  void Finish(std::vector<StageTime>* times) const {
    times->push_back(timer_.Stop(name_));
    context_.Info(name_ + Formatted(": %.2f s", times->back().seconds));
  }

 private:
  std::string name_;
  const Context& context_;
  Context context_of_work_;
  StageTimer timer_;
};

}  // namespace mgsfm
